"""What ends the operator: its watches, and each of the tasks beside them."""

import asyncio

import pytest

from bagpipe_operator.main import run_together
from tests.waiting import PATIENCE


async def _for_ever() -> None:
    await asyncio.Event().wait()


async def _faulty() -> None:
    raise RuntimeError("a bug")


async def _ended() -> None:
    """By a signal."""


async def test_a_task_that_ends_by_a_fault_ends_the_operator() -> None:
    """It would do nothing more, and nobody would know; the kubelet starts another process."""
    beside = asyncio.create_task(_for_ever())
    tasks = [beside, asyncio.create_task(_faulty())]
    with pytest.raises(RuntimeError, match="a bug"):
        async with asyncio.timeout(PATIENCE):
            await run_together(_for_ever(), tasks)
    assert beside.cancelled()


async def test_watches_that_end_by_a_signal_end_the_operator_without_a_fault() -> None:
    beside = asyncio.create_task(_for_ever())
    async with asyncio.timeout(PATIENCE):
        await run_together(_ended(), [beside])
    assert beside.cancelled()


async def test_watches_that_can_t_go_on_end_the_operator_with_their_fault() -> None:
    with pytest.raises(RuntimeError, match="a bug"):
        async with asyncio.timeout(PATIENCE):
            await run_together(_faulty(), [asyncio.create_task(_for_ever())])
