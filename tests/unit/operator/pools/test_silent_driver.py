"""A driver that waits and does not answer: it may have a job that is not in the view yet."""

import pytest

from bagpipe_operator.cluster.client import ApiError
from tests.unit.operator.pools.pool_world import World, pooled

WAITING = ["one-1-driver", "one-1-exec-1"]


async def waiting() -> World:
    """Job `one` has ended, and its driver waits."""
    world = World(pooled("one"))
    await world.run_the_first()
    world.create(pooled("crowd", "other"))
    return world


def room(world: World, lacks: bool) -> None:
    """Whether others need the room that the driver has, for which it is asked at each visit."""
    crowd = world.view.job("uid-of-crowd")
    assert crowd is not None
    world.reconciler._warm.note_room(crowd, in_quota=lacks, on_nodes=False)


async def lose_an_answer(world: World, after: float = 0) -> None:
    world.drivers.silent = True
    await world.visit("one", after)
    world.drivers.silent = False


async def test_two_lost_answers_are_no_silence_of_all_the_time_between_them() -> None:
    world = await waiting()
    room(world, lacks=True)
    await lose_an_answer(world)
    room(world, lacks=False)
    await world.visit("one", after=60)  # nobody asks it
    room(world, lacks=True)
    await lose_an_answer(world)
    assert world.pods() == WAITING
    await lose_an_answer(world, after=29.9)
    assert world.pods() == WAITING
    await lose_an_answer(world, after=0.1)
    assert world.pods() == []


async def test_a_silent_driver_whose_deletion_failed_is_not_waited_for_again() -> None:
    world = await waiting()
    room(world, lacks=True)
    await lose_an_answer(world)
    world.api.fail("delete one-1-driver", ApiError(500, "InternalError", "not now"))
    with pytest.raises(ApiError):
        await lose_an_answer(world, after=30)
    await lose_an_answer(world, after=2)
    assert world.pods() == []


@pytest.mark.parametrize("goes", ["ended", "by itself", "with its job"])
async def test_nothing_is_remembered_of_a_driver_that_is_gone(goes: str) -> None:
    world = await waiting()
    room(world, lacks=True)
    await lose_an_answer(world)
    if goes == "ended":
        await lose_an_answer(world, after=30)
        assert world.pods() == []
    if goes == "with its job":
        world.view.drop_job("uid-of-one")
    for pod in WAITING:
        world.goes(pod)
    await world.visit("one", after=1)
    assert world.reconciler._warm._silent._since == {}
