"""What of a status may wait while the API server is busy, and what may not."""

from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from bagpipe_operator.api.objects import Json
from bagpipe_operator.jobs.driver.progress import parse
from bagpipe_operator.jobs.policies.urgency import is_news, is_urgent
from tests.unit.operator.builders import account

FAULTS = ["failed", "invalid", "errored", "crashed", "lost", "regressed"]
COUNTS = ["planned", "running", "passed", "quarantined", "discarded", *FAULTS]


def condition(type_: str, message: str = "", **changes: Any) -> Json:
    whole = {
        "type": type_, "status": "True", "reason": "CasesRunning", "message": message,
        "observedGeneration": 1, "lastTransitionTime": "2026-11-20T04:00:00Z",
    }  # fmt: skip
    return whole | changes


def running(**changes: Any) -> Json:
    """The status of a running job, as the operator writes it."""
    progress = parse(account())
    assert progress is not None
    status = progress.as_status() | {
        "phase": "Running", "attempt": 1, "driver": "x-1-driver", "observedGeneration": 1,
        "conditions": [condition("Running", "Cases are running. 2 of 8 executors wait."),
                       condition("Suspended", status="False")],
    }  # fmt: skip
    return status | changes


def cases(**counts: int) -> Json:
    cases: Json = running()["cases"]
    return cases | counts


def worded(message: str = "Cases are running. 2 of 8 executors wait.", **changes: Any) -> Json:
    """The same with another sentence about its running."""
    old = running()["conditions"]
    return running(conditions=[condition("Running", message, **changes), *old[1:]])


@pytest.mark.parametrize(
    "computed",
    [
        running(cases=cases(passed=2, running=1)),
        running(cases=cases(planned=5)),
        running(cases=cases(quarantined=1, discarded=2)),
        running(ledger={"sent": 500, "received": 499, "dropped": 1, "leadIn": 8}),
        worded("Cases are running. 11 of 8 executors wait."),
    ],
)
def test_counts_and_words_with_counts_may_wait(computed: Json) -> None:
    assert not is_urgent(running(), computed)
    assert is_urgent(running(), computed | {"verdict": "Passed"})


# Promise: nothing-else-waits
@pytest.mark.parametrize(
    "computed",
    [
        *(running(cases=cases(**{fault: 1})) for fault in FAULTS),
        running(failures=[{"case": "a", "reason": "Late", "message": "late"}]),
        running(comparisons=[{"variant": "v", "verdict": "worse"}]),
        running(verdict="Failed"),
        running(results="pvc://results/other"),
        running(firstCaseTime="2026-11-20T04:00:00Z"),
        running(attempt=2),
        running(driver=""),
        running(observedGeneration=2),
        running(notifications=[]),
        running(anything="else"),
        running(phase="Planning"),
        worded("Cases are running. The node of 2 executors is gone."),
        worded(reason="ImagePull"),
        worded(status="False"),
        worded(observedGeneration=2),
        worded(lastTransitionTime="2026-11-20T04:00:01Z"),
        running(conditions=running()["conditions"][:1]),
        running(conditions=[]),
    ],
)
def test_all_else_is_urgent(computed: Json) -> None:
    assert is_urgent(running(), computed)


@pytest.mark.parametrize("key", ["cases", "ledger", "failures", "comparisons", "conditions"])
def test_what_comes_or_goes_as_a_whole_is_urgent(key: str) -> None:
    without = {name: value for name, value in running().items() if name != key}
    assert is_urgent(without, running())
    assert is_urgent(running(), without)


@pytest.mark.parametrize("phase", ["Pending", "Suspended", "Complete", "Failed", "Odd", None])
def test_what_no_round_comes_back_to_does_not_wait(phase: str | None) -> None:
    """A job that rests or has ended is visited by nothing but news."""
    written = running(phase=phase)
    assert is_urgent(written, written | {"cases": cases(passed=3)})


def test_more_failures_may_wait_and_fewer() -> None:
    one = {"case": "a", "reason": "Late", "message": "late"}
    written = running(failures=[one], cases=cases(failed=1))
    assert not is_urgent(written, running(failures=[one, one], cases=cases(failed=2)))
    assert not is_urgent(written, running(failures=[], cases=cases(failed=0)))
    # A fault of another kind is the first of it.
    assert is_urgent(written, running(failures=[one], cases=cases(failed=1, lost=1)))


def test_a_comparison_that_says_something_else_is_urgent() -> None:
    def compared(verdict: str, flaky: int = 0) -> Json:
        return running(comparisons=[{"variant": "v", "verdict": verdict, "flaky": flaky}])

    assert not is_urgent(compared("same"), compared("same", flaky=3))
    assert is_urgent(compared("same"), compared("worse"))


def test_what_a_stranger_wrote_is_judged_too() -> None:
    strange = running(cases="many", ledger=7, failures="none", comparisons=3, conditions="good")
    assert is_urgent(strange, running())
    assert not is_urgent(strange, strange)


COUNTED = st.fixed_dictionaries({name: st.integers(0, 3) for name in COUNTS})


@given(COUNTED, COUNTED)
def test_a_count_is_urgent_just_when_a_fault_is_the_first_of_its_kind(
    before: Json, after: Json
) -> None:
    first = any(after[fault] and not before[fault] for fault in FAULTS)
    assert is_urgent(running(cases=before), running(cases=after)) == first


@given(COUNTED, COUNTED)
def test_a_driver_that_counts_to_and_fro_is_urgent_one_way_at_most(
    before: Json, after: Json
) -> None:
    """One fault to and fro: what is urgent on the way up is progress on the way down."""
    for fault in FAULTS:
        one, none = running(cases=before | {fault: 1}), running(cases=before | {fault: 0})
        assert (is_urgent(none, one), is_urgent(one, none)) == (True, False)
    assert not is_urgent(running(cases=after), running(cases=after))


BEGUN = {"planned": 40, "running": 2, "passed": 1}


@pytest.mark.parametrize(
    "later",
    [
        account(cases=BEGUN | {"passed": 30, "running": 1}, message="30 of 40 cases"),
        account(cases=BEGUN, ledger={"sent": 9000, "received": 9000}, message="1 of 40 cases"),
        account(cases=BEGUN, message="31 of 40 cases"),
    ],
)
def test_counts_of_a_driver_are_no_news(later: str) -> None:
    assert not is_news(parse(account(cases=BEGUN, message="1 of 40 cases")), parse(later))


@pytest.mark.parametrize(
    "later",
    [
        *(account(cases=BEGUN | {fault: 1}) for fault in FAULTS),
        account("Planning", cases=BEGUN),
        account("Complete", cases=BEGUN, verdict="Passed"),
        account(cases=BEGUN, ended=True),
        account(cases=BEGUN, warning="the journal could not be written"),
        account(cases=BEGUN, verdict="Failed"),
        account(cases=BEGUN, results="pvc://results/elsewhere"),
        account(cases={"planned": 40}),
        account(cases=BEGUN, failures=[{"case": "a", "reason": "Lossy", "message": "3 lost"}]),
        account(cases=BEGUN, comparisons=[
            {"variant": "v", "verdict": "worse", "regressed": 1, "fixed": 0, "flaky": 0}]),
    ],
)  # fmt: skip
def test_what_a_driver_says_beyond_counts_is_news(later: str) -> None:
    taken = parse(account(cases=BEGUN))
    assert taken is not None
    assert is_news(taken, parse(later))
    assert is_news(None, taken)
    assert not is_news(None, None)
