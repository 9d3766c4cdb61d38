"""The comparisons of a job, made before its verdict, which they are a part of."""

import logging
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

from bagpipe.compare.gate import Objection, objections
from bagpipe.driver.baseline import baseline_rows
from bagpipe.run.case_run import Row
from bagpipe.spec import FoundBaseline, SimulationJobSpec
from bagpipe.storage import Storage, StorageError

if TYPE_CHECKING:
    from bagpipe.compare.compare import Comparison

_Make = Callable[[], list["Comparison"]]

log = logging.getLogger(__name__)


@dataclass(frozen=True)
class Compared:
    """What was found, as comparison.json has it, or why nothing could be.

    `reason` is CamelCase, empty where all that was asked for is there. `note` is for a comparison
    that was asked for and that nothing could be a part of yet: it changes no verdict.
    """

    found: list[dict[str, Any]] = field(default_factory=list)
    allowed: frozenset[str] = frozenset()
    reason: str = ""
    message: str = ""
    note: str = ""

    @property
    def objections(self) -> list[Objection]:
        """What speaks against the job and is not allowed."""
        return [each for one in self.found for each in objections(one, self.allowed)]


def in_short(comparison: dict[str, Any]) -> dict[str, Any]:
    """A comparison as the job's status has it."""
    counts = {name: comparison["counts"][name] for name in ("regressed", "fixed", "flaky")}
    return {"variant": comparison["variant"], "verdict": comparison["verdict"], **counts}


def compared(
    spec: SimulationJobSpec,
    rows: Callable[[], Iterable[Row]],
    storage: Storage,
    patiently: Callable[[_Make], list["Comparison"]] = lambda make: make(),
    followed: FoundBaseline | None = None,
) -> Compared:
    """The variants against each other, or against the baseline; nothing where none is asked for.

    `followed` is what spec.baseline.lastPassed stands for; with no job in it nothing is compared.
    A baseline that can't be read, however `patiently` it was tried, and a fault of ours cost no
    results, and are no Passed either.
    """
    baseline = spec.compared_with
    if followed is not None and not followed.job:
        # Variants are not compared with each other either: each was to be with an earlier job.
        return Compared(note=followed.message)
    if not baseline and len(spec.variants) < 2:
        return Compared()
    allowed = frozenset(spec.comparison.allow)
    names = [variant.name for variant in spec.variants]

    def made() -> list["Comparison"]:
        # It imports NumPy, 0.1 s before the first case of a job that compares nothing.
        from bagpipe.compare.compare import compare  # noqa: PLC0415

        earlier = baseline_rows(baseline, storage) if baseline else None
        return compare(rows(), names, earlier)

    try:
        found = patiently(made)
    except StorageError as error:
        log.warning("the baseline can't be read: %s", error)
        return Compared([], allowed, "BaselineUnreadable", f"spec.baseline can't be read: {error}")
    except Exception as error:  # the rows stand without it, and the verdict says so
        log.exception("the comparison failed")
        return Compared([], allowed, "ComparisonFailed", f"{type(error).__name__}: {error}")
    for one in found:
        log.info("%s: %s (%s)", one.variant, one.verdict, one.message)
    return Compared([one.as_json() for one in found], allowed)
