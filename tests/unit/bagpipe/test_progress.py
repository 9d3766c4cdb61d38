"""What a job says of its end fits where it is read, and keeps what to do about it."""

import json

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
