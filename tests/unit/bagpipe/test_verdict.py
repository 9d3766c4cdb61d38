"""A job's verdict: the gravest thing decides, whatever else there is and however often."""

from typing import Any

import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from bagpipe.driver.comparing import Compared
from bagpipe.driver.progress import Progress
from bagpipe.row_facts import OUTCOMES
from tests.unit.bagpipe.jobs import make_row
from tests.unit.compare.rows import only, row

GRAVITY = ("Passed", "Invalid", "Failed")
ALONE = {"passed": "Passed", "invalid": "Invalid", "failed": "Failed"}

# Comparisons that each have one thing to say, and what that makes of a job that passed.
PAIR = [row(0, "released"), row(0, "pr-812")]
COMPARISONS: dict[str, tuple[list[dict[str, Any]], str]] = {
    "same": (PAIR, "Passed"),
    "fixed": ([row(0, "released", "failed"), row(0, "pr-812")], "Passed"),
    "regressed": ([row(0, "released"), row(0, "pr-812", "failed")], "Failed"),
    "missing": ([*PAIR, row(1, "released")], "Failed"),
    "worse": (
        [row(n, v, figure=1.0 + (v == "pr-812")) for n in range(6) for v in ("released", "pr-812")],
        "Failed",
    ),
    "unknown": ([row(0, "pr-812")], "Invalid"),
}

evidence = st.lists(st.sampled_from(sorted(ALONE)), min_size=1, max_size=12)
compared = st.lists(st.sampled_from(sorted(COMPARISONS)), max_size=4)


def ended(outcomes: list[str], missing: int = 0, found: Compared | None = None) -> Progress:
    """A job whose cases ended so, and in which others gave no result."""
    progress = Progress("pvc://results/r")
    progress.begin(len(outcomes) + missing)
    for number, outcome in enumerate(outcomes):
        reason = "" if outcome == "passed" else "Why"
        progress.add(make_row(f"case-{number}", outcome, reason, result=None))
    progress.compare(found or Compared())
    progress.finish()
    return progress


def graver(*verdicts: str) -> str:
    return max(verdicts, key=GRAVITY.index)


@pytest.mark.parametrize(("outcome", "verdict"), ALONE.items())
def test_the_verdict_of_one_case_is_its_outcome(outcome: str, verdict: str) -> None:
    progress = ended([outcome])
    assert (progress.phase, progress.verdict) == ("Complete", verdict)
    assert progress.verdict_reason == ("" if verdict == "Passed" else verdict)


@given(evidence, evidence)
@example(["failed"], ["invalid"])
@example(["invalid"], ["failed"])
def test_the_cases_of_two_jobs_have_the_graver_verdict_of_the_two(
    some: list[str], others: list[str]
) -> None:
    both = ended(some + others)
    assert both.verdict == graver(ended(some).verdict, ended(others).verdict)
    assert both.verdict_reason == ("" if both.verdict == "Passed" else both.verdict)


# Promise: verdict-of-the-job
@given(st.lists(st.sampled_from(OUTCOMES), max_size=12), st.integers(0, 2))
def test_there_is_a_verdict_just_where_every_case_gave_evidence(
    outcomes: list[str], missing: int
) -> None:
    progress = ended(outcomes, missing)
    whole = bool(outcomes) and not missing and "errored" not in outcomes
    assert progress.phase == ("Complete" if whole else "Failed")
    assert bool(progress.verdict) == whole


@given(evidence, compared)
@example(["passed"], ["unknown", "regressed"])
@example(["invalid"], ["worse", "fixed"])
def test_what_a_comparison_says_makes_a_verdict_graver_and_never_better(
    outcomes: list[str], words: list[str]
) -> None:
    found = Compared([only(COMPARISONS[word][0]).as_json() for word in words])
    expected = graver(ended(outcomes).verdict, *(COMPARISONS[word][1] for word in words))
    assert ended(outcomes, found=found).verdict == expected


WORSE = [row(n, v, figure=1.0 + (v == "pr-812")) for n in range(6) for v in ("released", "pr-812")]


@pytest.mark.parametrize(
    ("more", "reason"),
    [
        ([], "WorseCriteria"),
        ([row(6, "released")], "Regressed"),
        ([row(6, "released"), row(6, "pr-812", "failed")], "Regressed"),
    ],
)
def test_the_gravest_cause_is_the_reason(more: list[dict[str, Any]], reason: str) -> None:
    found = Compared([only([*WORSE, *more]).as_json()])
    assert ended(["passed"], found=found).verdict_reason == reason


def test_what_comparisons_say_takes_a_bounded_part_of_the_message() -> None:
    comparison = only([row(0, "released"), row(0, "pr-812", "failed")]).as_json()
    found = Compared([comparison | {"variant": "x" * 300}] * 4)
    sentence = ended(["passed"], found=found).message
    assert len(sentence.removeprefix("1 of 1 cases ran, verdict Failed")) == 600


@given(evidence)
def test_a_baseline_that_can_t_be_read_leaves_no_job_passed(outcomes: list[str]) -> None:
    found = Compared(reason="BaselineUnreadable", message="spec.baseline can't be read: gone")
    assert ended(outcomes, found=found).verdict == graver("Invalid", ended(outcomes).verdict)
