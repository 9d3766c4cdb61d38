"""Whose write is made next where more are to be made than may be at once."""

import asyncio
from collections import Counter

import pytest

from bagpipe_operator.cluster.write_turns import SLOW_SECONDS, WriteTurns
from tests.unit.operator import virtual_time


class Writers:
    """Writes with turns of eight, two and sixteen, and when each of them was made."""

    def __init__(self) -> None:
        self.turns = WriteTurns(8, 2, 16)
        self.under_way: Counter[str] = Counter()
        self.most = 0
        self.begun: list[tuple[float, str]] = []
        self.tasks: list[asyncio.Task[None]] = []

    async def _write(self, namespace: str, seconds: float) -> None:
        async with self.turns.taken(namespace):
            self.under_way[namespace] += 1
            self.most = max(self.most, self.under_way.total())
            self.begun.append((asyncio.get_running_loop().time(), namespace))
            await asyncio.sleep(seconds)
            self.under_way[namespace] -= 1

    def write(self, namespace: str, seconds: float, count: int = 1) -> None:
        new = (self._write(namespace, seconds) for _ in range(count))
        self.tasks += [asyncio.create_task(each) for each in new]

    async def ended(self) -> None:
        await asyncio.gather(*self.tasks)


@pytest.mark.parametrize("slow", [["a"], ["a", "b"], ["a", "b", "c", "d", "e"]])
def test_slow_writes_of_several_namespaces_keep_none_of_another_waiting(slow: list[str]) -> None:
    """As where the webhooks of several namespaces hang, of one tenant or of more."""

    async def run() -> None:
        writers = Writers()
        for namespace in slow:
            writers.write(namespace, 10, 40)
        for number in range(60):
            await asyncio.sleep(0.5)
            writers.write(f"lanes-{number % 3}", 0.02)
            due = asyncio.get_running_loop().time()
            await asyncio.wait_for(writers.tasks[-1], SLOW_SECONDS + 0.1)
            assert writers.begun[-1][0] - due <= SLOW_SECONDS
        assert all(writers.under_way[namespace] <= 8 for namespace in slow)
        await writers.ended()

    virtual_time.run(run())


def test_the_next_turn_goes_to_who_has_fewest_and_has_waited_longest() -> None:
    async def run() -> list[str]:
        writers = Writers()
        writers.write("a", 0.5, 8)
        writers.write("b", 0.4, 2)
        await asyncio.sleep(0.1)
        for namespace in ("a", "b", "c", "d", "c"):
            writers.write(namespace, 0.5)
        await writers.ended()
        return [namespace for _, namespace in writers.begun[10:]]

    # The first that ends is one of b, which has another one then, and the second its last.
    assert virtual_time.run(run()) == ["c", "b", "d", "c", "a"]


def test_many_namespaces_make_no_more_writes_at_once_of_an_api_server_that_is_busy() -> None:
    """Their writes take long together, and none of them more than a second."""

    async def run() -> int:
        writers = Writers()
        for number in range(100):
            writers.write(f"lanes-{number}", 0.9, 2)
        await writers.ended()
        return writers.most

    assert virtual_time.run(run()) == 10


def test_writes_beside_slow_ones_have_a_bound() -> None:
    async def run() -> int:
        writers = Writers()
        for number in range(100):
            writers.write(f"slow-{number}", 10)
        await writers.ended()
        return writers.most

    assert virtual_time.run(run()) == 10 + 16


def test_who_is_cancelled_at_any_moment_keeps_no_turn() -> None:
    async def run() -> None:
        writers = Writers()
        writers.write("a", 0.1, 8)
        writers.write("b", 0.1, 4)
        await asyncio.sleep(0.1)  # turns end at this moment
        writers.write("c", 5, 12)
        for at in range(20):
            writers.tasks[at].cancel()
            await asyncio.sleep(0)
        await asyncio.sleep(2 * SLOW_SECONDS)
        for each in writers.tasks[20:]:
            each.cancel()
        await asyncio.gather(*writers.tasks, return_exceptions=True)
        assert (writers.turns._had_by, writers.turns._slow, writers.turns._waiting) == ({}, 0, {})

    virtual_time.run(run())


def test_who_was_cancelled_a_moment_before_a_turn_is_free_is_passed_over() -> None:
    async def run() -> None:
        turns, ends = WriteTurns(1, 0, 0), asyncio.Event()

        async def write() -> str:
            async with turns.taken("a"):
                await ends.wait()
                return "made"

        first, cancelled, last = [asyncio.create_task(write()) for _ in range(3)]
        await asyncio.sleep(0)
        ends.set()
        cancelled.cancel()
        done = await asyncio.gather(first, cancelled, last, return_exceptions=True)
        assert [isinstance(each, str) for each in done] == [True, False, True], done

    asyncio.run(run())
