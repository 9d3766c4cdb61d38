"""What became of each case that both versions have: a plain word, or a test over its rounds."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Literal

from bagpipe.compare.correction import holm
from bagpipe.compare.pairing import Rounds, windows_differ
from bagpipe.row_facts import Key

Word = Literal["regressed", "fixed", "flaky", "same", "unknown"]

# How often rounds that only differ by chance may be called regressed or fixed, in all cases.
_LEVEL = 0.05


@dataclass(frozen=True)
class Change:
    """One case; of a regressed one what became of it, and the reason that was given."""

    word: Word
    to: str = ""
    reason: str = ""


def changes(
    before: Mapping[Key, Rounds], after: Mapping[Key, Rounds], *, of_any_window: bool = False
) -> dict[Key, Change]:
    """Every case that both have.

    Of one that was another part of the recording nothing is known, unless it is taken for the
    same (`of_any_window`). Where all rounds agree, in both, their word is the case's. Else
    Fisher's exact test says whether so different shares of rounds may pass by chance, with
    Holm's correction over such cases; only where they may, the case is flaky.
    """
    found = {}
    tested = {}
    for key, now in after.items():
        if key not in before:
            continue
        then = before[key]
        if windows_differ(then, now) and not of_any_window:
            found[key] = Change("unknown")
        elif then.steady and now.steady:
            found[key] = _plain(then, now)
        else:
            found[key] = Change("flaky")
            tested[key] = _chance(then.passed, len(then.outcomes), now.passed, len(now.outcomes))
    for key, chance in zip(tested, holm(list(tested.values())), strict=True):
        if chance <= _LEVEL:
            found[key] = _moved(before[key], after[key])
    return found


def regressed(after: Rounds) -> Change:
    """It passed, and what it does now is something else."""
    return Change("regressed", after.worst, after.reason_of(after.worst))


def _plain(then: Rounds, now: Rounds) -> Change:
    """What did not pass before and gives no evidence now is no news of the stack, nor no change."""
    before, after = then.worst, now.worst
    if before == "passed":
        return Change("same") if after == "passed" else regressed(now)
    if before == "failed" and after == "passed":
        return Change("fixed")
    return Change("same" if before == after == "failed" else "unknown")


def passes_less_often(then: Rounds, now: Rounds) -> bool:
    """Whether a smaller share of its rounds passes now."""
    return now.passed * len(then.outcomes) < then.passed * len(now.outcomes)


def lost_together(pairs: Sequence[tuple[Rounds, Rounds]]) -> bool:
    """Whether a smaller share of all these cases' rounds passes now, and not by chance."""
    passed, passed_now = (sum(pair[of].passed for pair in pairs) for of in (0, 1))
    rounds, rounds_now = (sum(len(pair[of].outcomes) for pair in pairs) for of in (0, 1))
    fewer = passed_now * rounds < passed * rounds_now
    return fewer and _chance(passed, rounds, passed_now, rounds_now) <= _LEVEL


def _moved(then: Rounds, now: Rounds) -> Change:
    return regressed(now) if passes_less_often(then, now) else Change("fixed")


@lru_cache(maxsize=4096)
def _chance(passed: int, rounds: int, passed_now: int, rounds_now: int) -> float:
    """Two-sided, of so different shares in as many rounds."""
    # Loading it takes longer than the rest of a driver, and few jobs compare rounds that differ.
    from scipy.stats import fisher_exact  # noqa: PLC0415

    table = [[passed, rounds - passed], [passed_now, rounds_now - passed_now]]
    return float(fisher_exact(table).pvalue)
