"""What a job says of its end fits where it is read, and keeps what to do about it."""

import json
from typing import Any

from hypothesis import given
from hypothesis import strategies as st

from bagpipe.driver.progress import Progress, shortened
from bagpipe_operator.api.conditions import LONGEST_MESSAGE
from bagpipe_operator.jobs.driver.progress import parse
from tests.unit.bagpipe.jobs import make_row

ADVICE = "run the case again on a quieter machine, or in lock-step"
LONG = f"the machine could have caused a loss: {'steal up to 55 %; ' * 30}{ADVICE}"


def errored(message: str, cases: int = 1) -> Progress:
    progress = Progress("pvc://results/r")
    progress.begin(cases)
    for number in range(cases):
        row = make_row(f"case-{number}", "errored", "MachineBusy", message=message, result=None)
        progress.add(row)
    progress.finish()
    return progress


def test_the_advice_at_a_long_message_s_end_reaches_the_condition() -> None:
    snapshot = errored(LONG).snapshot()
    assert len(LONG) > 600
    assert snapshot["message"].endswith(ADVICE)
    assert snapshot["message"] == f"1 of 1 cases errored; case-0: MachineBusy: {LONG}"
    assert len(snapshot["message"]) <= LONGEST_MESSAGE
    (failure,) = snapshot["failures"]
    assert len(failure["message"]) == 300
    assert failure["message"].endswith(ADVICE)
    assert failure["message"].startswith("the machine could have caused a loss")


def test_the_operator_reads_all_of_the_longest() -> None:
    progress = errored("x" * 10_000 + ADVICE, cases=9)
    text = progress.termination_message()
    account = parse(text)
    assert len(text.encode()) <= 4096
    assert account is not None
    assert account.message.endswith(ADVICE)
    assert account.message == json.loads(text)["message"]


@given(st.text(max_size=400), st.integers(0, 300))
def test_a_shortened_message_has_its_bound_its_beginning_and_its_end(text: str, most: int) -> None:
    short = shortened(text, most)
    assert len(short) == min(len(text), most)
    if 20 <= most < len(text):
        third = most // 3
        assert (short[:third], short[-third:]) == (text[:third], text[-third:])
    else:
        assert short == text[:most]


def ended_with(outcomes: list[str], planned: int = 0) -> dict[str, Any]:
    progress = Progress("pvc://results/r")
    progress.begin(planned or len(outcomes))
    for number, outcome in enumerate(outcomes):
        progress.add(make_row(f"case-{number}", outcome, f"{outcome.capitalize()}Why"))
    progress.finish()
    return progress.snapshot()


def test_what_failed_is_no_reason_for_a_job_without_a_verdict() -> None:
    found = ended_with(["failed"] * 7 + ["errored"])
    assert (found["verdict"], found["reason"]) == ("", "ErroredWhy")
    assert found["message"] == "1 of 8 cases errored; case-7: ErroredWhy: why case-7"
    missing = ended_with(["passed", "failed"], planned=3)
    assert (missing["verdict"], missing["reason"]) == ("", "CasesMissing")
    assert missing["message"] == "1 of 3 cases gave no result"


def test_errors_of_several_reasons_are_one_reason_together() -> None:
    progress = Progress("pvc://results/r")
    progress.begin(3)
    for number in range(3):
        progress.add(make_row(f"case-{number}", "errored", f"Why{number}"))
    progress.finish()
    assert progress.snapshot()["reason"] == "CasesErrored"


def test_what_could_not_be_committed_has_no_verdict() -> None:
    progress = Progress("pvc://results/r")
    progress.begin(1)
    progress.add(make_row("case-0", "passed"))
    assert progress.finish()
    assert progress.snapshot()["verdict"] == "Passed"
    progress.fail("StorageFailed", "no room")
    found = progress.snapshot()
    assert (found["phase"], found["reason"]) == ("Failed", "StorageFailed")
    assert (found["verdict"], found["verdictReason"]) == ("", "")


def test_how_many_cases_ended_on_a_further_start_is_in_the_job_s_sentence() -> None:
    """A hang that the copy of its case does not share passes."""
    progress = Progress("r")
    progress.begin(10)
    for number in range(10):
        progress.add(make_row(f"a-{number}", starts=2 if number % 3 == 0 else 1))
    assert progress.finish()
    assert progress.snapshot()["message"] == (
        "10 of 10 cases ran, verdict Passed; 4 ended on a further start (`starts`)"
    )
