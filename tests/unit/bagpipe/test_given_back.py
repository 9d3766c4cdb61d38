"""Which cases that were given up run again, and with how many starts left."""

from typing import Any

import pytest

from bagpipe.driver.given_back import GivenBack, Tried
from bagpipe.run.case_run import Row
from tests.unit.bagpipe.jobs import make_row


def given_up(starts: int, taken_away: int, **changed: Any) -> Row:
    """A row as the driver gets it of a case that was started so often, in all its rounds."""
    lost = {"evidence": {"starts": [{"executor": str(number)} for number in range(starts)]}}
    row = make_row("a", "errored", "ExecutorLost", starts=starts, taken_away=taken_away)
    return row | lost | changed


@pytest.mark.parametrize(("launches", "enough"), [(0, False), (3, False), (4, True), (5, True)])
def test_a_worker_gives_a_case_up_after_four_launches(launches: int, enough: bool) -> None:
    assert Tried().is_enough(launches) is enough


@pytest.mark.parametrize(
    ("tried", "launches", "enough"),
    [
        (Tried(starts=4, faults=0), 3, False),
        (Tried(starts=4, faults=0), 4, True),
        (Tried(starts=4, faults=3), 0, False),
        (Tried(starts=4, faults=3), 1, True),
        (Tried(starts=17, faults=0), 2, False),
        (Tried(starts=17, faults=0), 3, True),
    ],
)
def test_what_counted_against_a_case_goes_on_counting(
    tried: Tried, launches: int, enough: bool
) -> None:
    assert tried.is_enough(launches) is enough


@pytest.mark.parametrize(
    ("taken_away", "tried"),
    [(4, Tried(4, 0)), (1, Tried(4, 3)), (0, None)],
    ids=["all", "one", "none"],
)
def test_a_case_runs_again_where_executors_were_taken_away(
    taken_away: int, tried: Tried | None
) -> None:
    given_back = GivenBack()
    kept = given_back.sift([make_row("b"), given_up(4, taken_away)])
    assert [row["case"] for row in kept] == ["b"] if tried else ["b", "a"]
    assert given_back.again == ({"a"} if tried else set())
    assert given_back.tried == ({"a": tried} if tried else {})
    assert all("taken_away" not in row for row in kept)


def test_it_is_given_up_once_four_starts_were_its_own_fault() -> None:
    given_back = GivenBack()
    assert given_back.sift([given_up(4, 2)]) == []
    # Two count; of the next two one was taken away.
    assert given_back.sift([given_up(6, 1)]) == []
    assert given_back.tried == {"a": Tried(6, 3)}
    (row,) = given_back.sift([given_up(7, 0)])
    assert (row["outcome"], row["reason"], row["starts"]) == ("errored", "ExecutorLost", 7)
    # The newest ones of all rounds.
    assert [start["executor"] for start in row["evidence"]["starts"]] == [
        "3", "4", "5", *map(str, range(7)),
    ]  # fmt: skip


def test_a_case_that_its_nodes_may_die_of_is_given_up_after_twenty_starts() -> None:
    given_back = GivenBack()
    for starts in (4, 8, 12, 16):
        assert given_back.sift([given_up(starts, 4)]) == []
    (row,) = given_back.sift([given_up(20, 4)])
    assert (row["reason"], row["starts"], len(row["evidence"]["starts"])) == (
        "ExecutorLost", 20, 10,
    )  # fmt: skip


def test_more_starts_taken_away_than_there_were_count_for_none() -> None:
    """Spark reports a speculative copy's executor as well."""
    given_back = GivenBack()
    assert given_back.sift([given_up(4, 9)]) == []
    assert given_back.tried == {"a": Tried(4, 0)}
