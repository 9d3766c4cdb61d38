"""The queue: coalescing, one worker per key, and retries whose times are asserted."""

import asyncio

import pytest

from bagpipe_operator.queue import RETRY_LIMIT, WorkQueue, retry_delay
from tests.unit.operator.builders import Clock


async def test_a_key_that_is_asked_for_often_is_worked_on_once() -> None:
    queue = WorkQueue()
    for key in ("a", "b", "a", "a"):
        queue.add(key)
    assert len(queue) == 2
    assert [await queue.get(), await queue.get()] == ["a", "b"]


async def test_a_key_that_is_being_worked_on_comes_again_afterwards() -> None:
    queue = WorkQueue()
    queue.add("a")
    assert await queue.get() == "a"
    queue.add("a")
    queue.add("a")
    assert len(queue) == 0
    queue.done("a")
    assert await queue.get() == "a"
    queue.done("a")
    assert len(queue) == 0


async def test_a_waiting_worker_is_woken() -> None:
    queue = WorkQueue()
    waiting = asyncio.create_task(queue.get())
    await asyncio.sleep(0)
    assert not waiting.done()
    queue.add("a")
    assert await asyncio.wait_for(waiting, 1) == "a"


def test_the_delays() -> None:
    assert [retry_delay(n) for n in range(1, RETRY_LIMIT + 2)] == [
        0.5, 1, 2, 4, 8, 16, 30, 30, 120,
    ]  # fmt: skip


async def test_the_sweeper_waits_for_the_retry_and_an_event_does_not() -> None:
    clock = Clock()
    queue = WorkQueue(clock.monotonic)
    queue.add("a")
    await queue.get()
    assert queue.retry("a") == pytest.approx(0.5)
    clock.advance(0.4)
    queue.add_if_rested("a")
    assert len(queue) == 0
    clock.advance(0.1)
    queue.add_if_rested("a")
    assert await queue.get() == "a"
    assert queue.retry("a") == pytest.approx(1.0)
    queue.add("a")
    assert await queue.get() == "a"
    queue.done("a")
    queue.add_if_rested("a")
    assert await queue.get() == "a"
    assert queue.retry("a") == pytest.approx(0.5)
