"""The search finds the first bad version of any list that gets bad once, in as few looks as there
can be, and says nothing that was not seen of any other list.
"""

import math

import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from bagpipe.cli.first_bad import Found, found, next_look, wrong_end
from bagpipe.cli.judged_step import Word

between: st.SearchStrategy[list[Word]] = st.lists(
    st.sampled_from(["good", "bad", "unknown"]), max_size=40
)


def broken(first: int, count: int) -> list[Word]:
    """Versions of which this one is the first bad one."""
    return ["bad" if number >= first else "good" for number in range(count)]


def searched(versions: list[Word]) -> tuple[dict[int, Word], list[int]]:
    """What the search has seen of these versions, and in which order it looked."""
    words: dict[int, Word] = {}
    looks: list[int] = []
    while (number := next_look(len(versions), words)) is not None:
        assert number not in words
        looks.append(number)
        words[number] = versions[number]
    return words, looks


@given(st.integers(2, 3000), st.data())
def test_the_first_bad_one_is_found_in_as_few_looks_as_there_can_be(
    count: int, data: st.DataObject
) -> None:
    first = data.draw(st.integers(1, count - 1))
    words, looks = searched(broken(first, count))
    assert found(count, words) == Found(first - 1, (first,))
    assert looks[:2] == [0, count - 1]
    assert len(looks) <= 2 + math.ceil(math.log2(count - 1))


@given(between)
@example(["bad", "good"])
@example(["unknown"] * 5)
def test_what_is_named_was_seen_whatever_the_list_is(inner: list[Word]) -> None:
    versions: list[Word] = ["good", *inner, "bad"]
    words, _ = searched(versions)
    answer = found(len(versions), words)
    assert words[answer.good] == "good"
    assert words[answer.bad[-1]] == "bad"
    assert answer.bad == tuple(range(answer.good + 1, answer.bad[-1] + 1))
    # All between were looked at, and none could be judged.
    assert {words[number] for number in answer.bad[:-1]} <= {"unknown"}


@given(st.integers(1, 60), st.sets(st.integers(1, 60)), st.data())
def test_versions_that_can_t_be_judged_cost_two_looks_each_at_most(
    first: int, unknown: set[int], data: st.DataObject
) -> None:
    count = first + data.draw(st.integers(1, 60))
    versions = broken(first, count)
    skipped = {number for number in unknown if 0 < number < count - 1}
    versions = ["unknown" if number in skipped else word for number, word in enumerate(versions)]
    words, looks = searched(versions)
    answer = found(count, words)
    assert first in answer.bad
    assert set(answer.bad[:-1]) <= skipped
    assert len(looks) <= 2 + math.ceil(math.log2(max(2, count - 1))) + 2 * len(skipped)


@pytest.mark.parametrize(
    ("first", "last", "sentence"),
    [
        ("bad", "bad", "the good end fails as well"),
        ("unknown", "bad", "the good end can't be judged"),
        ("good", "good", "the bad end passes"),
        ("good", "unknown", "the bad end can't be judged"),
        ("good", "bad", ""),
    ],
)
def test_a_wrong_end_ends_the_search(first: Word, last: Word, sentence: str) -> None:
    words, looks = searched([first, "good", last])
    assert len(looks) == 2 + (not sentence)
    assert wrong_end(3, words).startswith(sentence)
    assert bool(wrong_end(3, words)) == bool(sentence)


def test_the_nearest_to_the_middle_is_next_where_that_can_t_be_judged() -> None:
    words: dict[int, Word] = {0: "good", 8: "bad", 4: "unknown"}
    assert next_look(9, words) == 3
    assert next_look(9, words | {3: "unknown"}) == 5
