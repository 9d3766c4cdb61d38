"""One at a time, and of each who asks one at most."""

import threading

from bagpipe.driver.turns import Turns
from tests.waiting import PATIENCE, wait_until


def test_who_has_a_turn_gets_no_second_one_and_another_waits_for_so_long() -> None:
    turns = Turns(0.01)
    with turns.taken("a") as first, turns.taken("a") as second, turns.taken("b") as other:
        assert (first, second, other) == (True, False, False)
    for by in ("b", "a"):
        with turns.taken(by) as again:
            assert again, by


def test_of_those_who_wait_each_has_its_turn() -> None:
    turns, got = Turns(PATIENCE), []

    def take(by: str) -> None:
        with turns.taken(by) as has_it:
            got.append((by, has_it))

    waiting = [threading.Thread(target=take, args=(by,)) for by in "bcd"]
    with turns.taken("a"):
        for thread in waiting:
            thread.start()
        wait_until(lambda: turns._asking == set("abcd"), PATIENCE, "those who wait")
        take("b")
        assert got == [("b", False)]
    for thread in waiting:
        thread.join(PATIENCE)
    assert sorted(got) == [("b", False), ("b", True), ("c", True), ("d", True)]
    assert turns._asking == set()
