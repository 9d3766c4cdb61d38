"""A version is good or bad by what was seen alone; what flakes or was not seen is neither."""

from typing import Any

from hypothesis import example, given
from hypothesis import strategies as st

from bagpipe.cli.judged_step import Step, is_decided, of_round, of_rounds
from bagpipe.row_facts import OUTCOMES

GOOD, BAD, UNKNOWN = Step("good", "g"), Step("bad", "b"), Step("unknown", "u")

outcomes = st.lists(st.sampled_from(OUTCOMES), max_size=6)
rounds = st.lists(st.sampled_from([GOOD, BAD, UNKNOWN]), max_size=6)


def cases(*outcomes: str) -> list[dict[str, Any]]:
    return [
        {"case": f"a-{n}", "outcome": outcome, "reason": "Why" * (outcome != "passed")}
        for n, outcome in enumerate(outcomes)
    ]


@given(outcomes, st.integers(0, 2))
@example(["passed", "passed"], 1)
@example(["failed", "errored"], 1)
@example([], 0)
def test_a_round_is_good_by_all_and_bad_by_one(outcomes: list[str], missing: int) -> None:
    word = of_round(cases(*outcomes), len(outcomes) + missing).word
    assert (word == "good") == (bool(outcomes) and set(outcomes) == {"passed"} and not missing)
    assert (word == "bad") == ("failed" in outcomes)


def test_a_name_without_a_case_is_not_good_however_many_others_passed() -> None:
    step = of_round(cases("passed", "passed"), 2, ("a-*", "b-0"))
    assert (step.word, step.why) == ("unknown", "the job has no case b-0")
    assert of_round(cases("passed", "passed"), 2, ("a-*", "a-0")).word == "good"
    assert of_round(cases("failed"), 1, ("b-0",)).word == "bad"


@given(rounds)
def test_rounds_say_what_all_of_them_say(rounds: list[Step]) -> None:
    words = {each.word for each in rounds}
    found = of_rounds(rounds).word
    assert found == (words.pop() if len(words) == 1 else "unknown")


@given(rounds, rounds)
def test_what_is_decided_no_further_round_changes(rounds: list[Step], more: list[Step]) -> None:
    if is_decided(rounds):
        assert of_rounds(rounds + more).word == "unknown"
    else:
        assert {of_rounds([*rounds, each]).word for each in (GOOD, BAD)} != {"unknown"}


def test_the_sentences_name_what_was_seen() -> None:
    seen = cases("passed", "failed", "errored", "failed", "failed", "failed")
    assert of_round(seen, 6).why == "a-1: Why; a-3: Why; a-4: Why; and 1 more"
    assert of_round(cases("failed", "failed", "failed"), 3).why == "a-0: Why; a-1: Why; a-2: Why"
    assert of_round(cases("passed", "invalid"), 2).why == "a-1: Why"
    unnamed = [{"case": "a", "outcome": "errored", "reason": "", "message": "no node came up"}]
    assert of_round(unnamed, 1).why == "a: errored: no node came up"
    assert of_round([], 0) == Step("unknown", "0 of 0 cases gave a result")
    assert of_rounds([]) == Step("unknown", "nothing ran")
    assert of_round(cases("passed"), 2).why == "1 of 2 cases gave a result"
    assert of_round(cases("passed"), 1).why == "1 of 1 cases passed"
    flaky = of_rounds([GOOD, BAD])
    assert flaky.why.startswith("1 of 2 rounds passed: it flakes here")
    assert of_rounds([GOOD, UNKNOWN]) == UNKNOWN
