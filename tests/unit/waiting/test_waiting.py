"""What all tests wait with gives what it saw, and ends."""

from itertools import islice

import pytest

from tests.waiting import NotSeenError, patient, pauses, wait_until


def test_it_looks_until_there_is_something_and_gives_that() -> None:
    seen = iter([None, "", "x", "y"])
    assert wait_until(lambda: next(seen), 60, "nothing came", every=0) == "x"
    assert next(seen) == "y"


def test_it_looks_at_least_once_and_says_what_was_not_there() -> None:
    looks: list[None] = []
    with pytest.raises(NotSeenError, match=r"^after -1 s: no pod came$") as missed:
        wait_until(lambda: looks.append(None), -1, "no pod came")
    assert looks == [None]
    assert isinstance(missed.value, AssertionError)
    assert isinstance(missed.value, TimeoutError)


def test_a_sentence_is_made_after_the_last_look() -> None:
    looks: list[None] = []
    with pytest.raises(NotSeenError, match=r": 1 looks$"):
        wait_until(lambda: looks.append(None), -1, lambda: f"{len(looks)} looks")


def test_what_is_long_in_coming_is_looked_for_more_seldom() -> None:
    found = list(islice(pauses(0.02), 8))
    assert found == pytest.approx([0.02, 0.03, 0.045, 0.0675, 0.10125, 0.151875, 0.2, 0.2])
    assert list(islice(pauses(0.5), 3)) == [0.5, 0.5, 0.5]
    assert list(islice(pauses(0), 3)) == [0, 0, 0]


def test_a_job_waits_long_for_its_stack_unless_it_says_how_long() -> None:
    given = {"playback": {"steps": [{"trigger": "/a", "answer": "/b", "deadline": "2s"}]}}
    assert patient(given)["playback"] == {
        "subscribeTimeout": "120s",
        "steps": [{"trigger": "/a", "answer": "/b", "deadline": "60s"}],
    }
    assert patient({})["playback"] == {"subscribeTimeout": "120s"}
    brief = {"playback": {"subscribeTimeout": "5s"}}
    assert patient(brief)["playback"] == {"subscribeTimeout": "5s"}
