"""The queue: coalescing, one worker per key, and retries whose times are asserted."""

import asyncio

import pytest

from bagpipe_operator.runtime.queue import (
    RETRY_LIMIT,
    TURNS,
    Lane,
    WorkQueue,
    most_in_lane,
    retry_delay,
)
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
    assert await asyncio.wait_for(waiting, 60) == "a"


async def test_a_key_goes_to_one_worker_and_a_cancelled_worker_loses_none() -> None:
    queue = WorkQueue()
    waiting = [asyncio.create_task(queue.get()) for _ in range(5)]
    await asyncio.sleep(0)
    queue.add("a")
    queue.add("a")
    for _ in range(3):
        await asyncio.sleep(0)
    assert [task.done() for task in waiting] == [True, False, False, False, False]
    queue.add("b")
    waiting[1].cancel()  # it was woken for b, or would have been
    for _ in range(5):
        await asyncio.sleep(0)
    assert [task.result() for task in waiting if task.done() and not task.cancelled()] == ["a", "b"]
    for task in waiting[3:]:
        task.cancel()


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


async def test_keys_that_have_failed_are_named_when_they_are_due() -> None:
    clock = Clock()
    queue = WorkQueue(clock.monotonic)
    for key in ("a", "b", "fine"):
        queue.add(key)
        await queue.get()
    queue.done("fine")
    queue.retry("a")
    clock.advance(0.3)
    queue.retry("b")
    assert queue.rested() == []
    clock.advance(0.2)
    assert queue.rested() == ["a"]
    clock.advance(0.3)
    assert queue.rested() == ["a", "b"]
    queue.add("a")
    await queue.get()
    assert queue.rested() == ["b"]  # what becomes of the other is not known yet
    queue.done("a")
    queue.forget("b")
    assert queue.rested() == []


async def _taken(queue: WorkQueue, count: int) -> list[str]:
    keys = []
    for _ in range(count):
        keys.append(await queue.get())
        queue.done(keys[-1])
    return keys


async def test_new_jobs_get_one_turn_of_four_however_many_jobs_run() -> None:
    queue = WorkQueue()
    for n in range(100):
        queue.add(f"new-{n}", Lane.START)
        queue.add(f"news-{n}")
        queue.add_if_rested(f"round-{n}")
    taken = await _taken(queue, 4 * TURNS)
    assert [key for key in taken if key.startswith("new-")] == ["new-0", "new-1", "new-2", "new-3"]
    assert sum(key.startswith("news-") for key in taken) == 8
    assert sum(key.startswith("round-") for key in taken) == 4


async def test_lanes_take_turns_in_one_order_whoever_was_first() -> None:
    queue = WorkQueue()
    for lane in (Lane.START, Lane.ROUND, Lane.NEWS):
        for n in range(4):
            queue.add(f"{lane.name}-{n}", lane)
    assert await _taken(queue, 8) == [
        "START-0", "NEWS-0", "ROUND-0", "NEWS-1", "START-1", "NEWS-2", "ROUND-1", "NEWS-3",
    ]  # fmt: skip


async def test_news_of_a_key_come_before_what_is_only_looked_at() -> None:
    queue = WorkQueue()
    queue.add("new", Lane.START)
    for key in ("visited", "reported"):
        queue.add(key, Lane.ROUND)
    queue.add("reported")
    assert await _taken(queue, 3) == ["new", "reported", "visited"]


async def test_a_visit_takes_no_new_job_out_of_its_lane() -> None:
    queue = WorkQueue()
    for key in ("first", "second"):
        queue.add(key, Lane.START)
    for key in ("second", "third"):
        queue.add_if_rested(key)
    assert await _taken(queue, 3) == ["first", "third", "second"]


async def test_a_key_that_never_failed_is_rested_by_a_clock_that_has_just_begun() -> None:
    queue = WorkQueue(lambda: 0.0)
    queue.add_if_rested("a")
    assert await queue.get() == "a"


async def test_a_turn_that_a_lane_does_not_need_is_the_others() -> None:
    queue = WorkQueue()
    for n in range(9):
        queue.add(f"new-{n}", Lane.START)
    assert await _taken(queue, 9) == [f"new-{n}" for n in range(9)]
    queue.add_if_rested("round")
    queue.add("news")
    assert await _taken(queue, 2) == ["news", "round"]


async def test_only_news_take_a_key_out_of_its_lane() -> None:
    queue = WorkQueue()
    queue.add("first", Lane.START)
    queue.add("second", Lane.START)
    queue.add_if_rested("second")  # the sweeper visits jobs that have not begun, too
    queue.add_if_rested("third")
    queue.add("third")
    assert len(queue) == 3
    assert await _taken(queue, 2) == ["first", "third"]
    assert await queue.get() == "second"
    queue.add("second", Lane.ROUND)
    queue.add("second")
    queue.add("other", Lane.ROUND)
    queue.done("second")
    assert await _taken(queue, 2) == ["second", "other"]


async def test_neither_new_jobs_nor_rounds_have_all_workers_of_a_tenant() -> None:
    """Their visits wait for what they write, and news would wait with them."""
    queue = WorkQueue(tenant_of=lambda key: key[0], workers=8)
    for number in range(9):
        queue.add(f"a-new-{number}", Lane.START)
        queue.add(f"a-round-{number}", Lane.ROUND)
    begun = [await queue.get() for _ in range(4)]
    assert sorted(begun) == ["a-new-0", "a-new-1", "a-round-0", "a-round-1"]
    waiting = asyncio.create_task(queue.get())
    await asyncio.sleep(0)
    assert not waiting.done()
    queue.add("a-fault")
    assert await waiting == "a-fault"
    queue.add("b-new", Lane.START)
    assert await queue.get() == "b-new"
    waiting = asyncio.create_task(queue.get())
    await asyncio.sleep(0)
    queue.done("a-round-0")
    assert await waiting == "a-round-2"


def test_however_few_workers_there_are_each_lane_has_one() -> None:
    assert [most_in_lane(workers) for workers in (1, 2, 4, 32)] == [1, 1, 1, 8]
