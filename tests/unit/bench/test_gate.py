"""The gate's error rates: what counts as an error, what has no answer, and what has flipped."""

from tests.bench.gate_tally import Answer, Tally
from tests.liars.jobs import SOME
from tests.liars.row import Row

PASSED: Answer = ("passed", "")
FAILED: Answer = ("failed", "CriterionFailed")
BUSY: Answer = ("errored", "MachineBusy")
LIAR = Row("liar", "time", "lies", SOME, ("x",), "failed")
HONEST = Row("honest", "time", "is odd", SOME, ("x",), "passed")


def tally(*rounds: tuple[Answer, Answer]) -> Tally:
    made = Tally([LIAR, HONEST])
    for of_liar, of_honest in rounds:
        made.add({"liar": of_liar, "honest": of_honest})
    return made


def test_a_liar_that_passes_and_an_honest_stack_that_is_refused_are_errors() -> None:
    made = tally((PASSED, FAILED), (FAILED, PASSED), (FAILED, PASSED))
    assert made.count({"passed"}, honest=False) == 1
    assert made.count({"failed", "invalid"}, honest=True) == 1
    assert {name: dict(found) for name, found in made.errors().items()} == {
        "liar": {PASSED: 1},
        "honest": {FAILED: 1},
    }
    assert "liar: 2 x failed CriterionFailed, 1 x passed" in made.report()


def test_what_errored_has_no_answer_and_is_counted_apart() -> None:
    made = tally((BUSY, BUSY), (FAILED, PASSED))
    assert made.errors() == {}
    assert made.headline() == (
        "0 of 2 runs of liars passed, 0 of 2 runs of honest stacks were refused, without an"
        " answer 1 and 1"
    )
    assert set(made.flips()) == {"liar", "honest"}


def test_the_interval_of_no_error_in_twenty_runs_is_exact() -> None:
    made = tally(*[(FAILED, PASSED)] * 20)
    # 1 - 0.025 ** (1 / 20)
    assert "| liars passed | 20 | 0 | 0.00% | 0.00% to 16.84% | 0 |" in made.report()
    assert [list(row.ours) for row in made.rows()] == [[0] * 20] * 4
