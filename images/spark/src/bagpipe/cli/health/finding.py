"""What a check found, and what a set of them comes to."""

from collections.abc import Iterable
from dataclasses import asdict, dataclass
from typing import Any, Literal

State = Literal["done", "missing", "unknown"]


@dataclass(frozen=True)
class Finding:
    """One check. `part` is machine, cluster, namespace or job; `what` names it in a few words.

    `remedy` says what to do about what is missing or unknown. One that is `optional` is missed by
    none of the verbs that were asked about.
    """

    part: str
    what: str
    state: State
    found: str
    remedy: str = ""
    optional: bool = False

    def as_json(self) -> dict[str, Any]:
        """The finding as data."""
        return asdict(self)


def status_of(findings: Iterable[Finding], reached: bool) -> int:
    """0 where nothing is missing that is needed, 1 where something is, 2 where the cluster that was
    to be asked did not answer.
    """
    if any(each.state == "missing" and not each.optional for each in findings):
        return 1
    return 0 if reached else 2
