"""A job's verdict, from its cases that count and from what they were compared with. Pure."""

from collections.abc import Mapping
from dataclasses import dataclass

from bagpipe.compare.gate import CAUSES
from bagpipe.driver.comparing import Compared
from bagpipe.row_facts import OUTCOMES

# Of what one part of the job's message says.
MOST_WHY = 600


@dataclass(frozen=True)
class Verdict:
    """The word, the one word for its reason (empty for Passed), and what else there is to say."""

    word: str
    reason: str = ""
    why: str = ""


def verdict_of(counting: Mapping[str, int], compared: Compared) -> Verdict:
    """The gravest thing decides. `counting` has the outcomes of the cases outside of quarantine.

    Of a job none of whose cases counts nothing was shown, however many passed.
    """
    against = compared.objections
    why = "".join(f"; {each.message}" for each in against)[:MOST_WHY]
    causes = {each.cause for each in against}
    worse = [cause for cause in CAUSES if cause in causes and cause != "Unknown"]
    if counting["failed"]:
        return Verdict("Failed", "Failed", why)
    if worse:
        return Verdict("Failed", "Regressed" if worse[0] == "Missing" else worse[0], why)
    if not any(counting[outcome] for outcome in OUTCOMES):
        return Verdict("Invalid", "AllQuarantined", f"; no case counts: all are in quarantine{why}")
    if counting["invalid"]:
        return Verdict("Invalid", "Invalid", why)
    if compared.reason:
        return Verdict("Invalid", compared.reason, f"; {compared.message[:MOST_WHY]}")
    return Verdict("Invalid", "NothingCompared", why) if against else Verdict("Passed")
