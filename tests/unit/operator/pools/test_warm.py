"""Which driver a job takes over, which may wait, and which wait no longer."""

from dataclasses import replace
from datetime import datetime, timedelta
from typing import Any

import pytest

from bagpipe_operator.jobs.pools.warm import (
    Cold,
    Crowd,
    Pooling,
    WarmDriver,
    Wish,
    chosen,
    leaving,
)
from tests.unit.operator.builders import START

POOLING = Pooling(enabled=True, idle_seconds=300.0, per_namespace=2)
WISH = Wish("lanes", "nightly", "shape-1")


def after(seconds: float) -> datetime:
    return START + timedelta(seconds=seconds)


def warm(uid: str, **changed: Any) -> WarmDriver:
    driver = WarmDriver(uid, "lanes", "nightly", "shape-1", idle_since=START)
    return replace(driver, **changed)


def choice(
    *drivers: WarmDriver, wish: Wish = WISH, pooling: Pooling = POOLING, at: float = 20
) -> str:
    found = chosen(wish, drivers, pooling, after(at))
    return found.reason if isinstance(found, Cold) else found.uid


def test_a_driver_of_the_same_pool_and_pods_is_taken_over() -> None:
    assert choice(warm("d")) == "d"


@pytest.mark.parametrize(
    ("changed", "reason"),
    [
        ({"namespace": "depths"}, "NoneWaits"),
        ({"pool": "daily"}, "NoneWaits"),
        ({"shape": "shape-2"}, "PodsDiffer"),
        ({"idle_since": None}, "NoneWaits"),
    ],
)
def test_one_that_differs_or_has_a_job_is_not(changed: dict[str, Any], reason: str) -> None:
    assert choice(warm("d", **changed)) == reason


@pytest.mark.parametrize(
    ("changed", "reason"), [({"queue": "team"}, "Queued"), ({"pulls": True}, "ImagePulled")]
)
def test_a_job_that_can_t_take_any_over_starts_cold(changed: dict[str, Any], reason: str) -> None:
    assert choice(warm("d"), wish=replace(WISH, **changed)) == reason


def test_where_pools_are_off_every_job_starts_cold_and_says_whom_to_ask() -> None:
    off = replace(POOLING, enabled=False)
    assert choice(warm("d"), pooling=off) == "PoolsOff"
    found = chosen(WISH, [], off, START)
    assert isinstance(found, Cold)
    assert found.message == (
        "This installation keeps no drivers: ask an administrator for pools.enabled of the Helm "
        "chart."
    )


def test_a_driver_that_could_end_during_the_handover_is_not_offered() -> None:
    assert choice(warm("d"), at=290) == "d"
    assert choice(warm("d"), at=290.001) == "AboutToEnd"


def test_of_several_the_one_that_waited_shortest_is_taken_and_uids_settle_the_rest() -> None:
    long, short = warm("a", idle_since=after(-50)), warm("b")
    assert choice(long, short) == choice(short, long) == "b"
    assert choice(warm("e"), warm("c"), warm("d")) == "c"
    assert choice(warm("a", shape="shape-2", idle_since=after(10)), warm("b")) == "b"


LANES = Crowd("lanes", after(30))


def ends(
    *drivers: WarmDriver,
    crowded: tuple[Crowd, ...] = (),
    pooling: Pooling = POOLING,
    at: float = 20,
) -> list[tuple[str, str]]:
    return [(d.uid, why) for d, why in leaving(drivers, crowded, pooling, after(at))]


def test_a_driver_waits_in_peace_while_it_may() -> None:
    assert ends(warm("a"), warm("b"), warm("c", namespace="depths")) == []


def test_a_driver_that_has_a_job_is_never_ended() -> None:
    off = replace(POOLING, enabled=False, per_namespace=0)
    busy = warm("a", idle_since=None)
    assert ends(busy, crowded=(LANES,), pooling=off, at=9999) == []


def test_where_a_job_waits_for_room_waiting_drivers_make_it() -> None:
    drivers = [warm("a"), warm("b", namespace="depths")]
    assert ends(*drivers, crowded=(LANES,)) == [("a", "RoomNeeded")]


def test_a_job_that_no_node_has_room_for_ends_those_that_wait_when_it_begins_to() -> None:
    """And none that waits later: else one job that no node can hold would end the pools of all."""
    drivers = [warm("a", idle_since=after(9)), warm("b", idle_since=after(9.5)),
               warm("c", idle_since=after(8))]  # fmt: skip
    nodes = Crowd("depths", after(9), on_nodes=True)
    pooling = replace(POOLING, per_namespace=3)
    found = ends(*drivers, crowded=(nodes,), pooling=pooling)
    assert found == [("c", "RoomNeeded"), ("a", "RoomNeeded")]
    drivers.pop()
    assert ends(*drivers, crowded=(replace(nodes, on_nodes=False),)) == []
    assert ends(*drivers, crowded=(replace(nodes, namespace="lanes"),)) == [
        ("a", "RoomNeeded"), ("b", "RoomNeeded"),
    ]  # fmt: skip


def test_one_that_has_not_ended_by_itself_is_ended_half_a_minute_late() -> None:
    assert ends(warm("a"), at=329.999) == []
    assert ends(warm("a"), at=330) == [("a", "IdleTooLong")]


def test_where_pools_were_switched_off_all_that_wait_end() -> None:
    off = replace(POOLING, enabled=False)
    assert ends(warm("a"), crowded=(LANES,), pooling=off) == [("a", "PoolsOff")]


def test_too_many_in_a_namespace_end_those_first_that_waited_longest() -> None:
    drivers = [warm("a", idle_since=after(3)), warm("b", idle_since=after(1)),
               warm("c", idle_since=after(4)), warm("d", idle_since=after(2)),
               warm("e", namespace="depths")]  # fmt: skip
    assert ends(*drivers) == [("b", "TooMany"), ("d", "TooMany")]
    none = replace(POOLING, per_namespace=0)
    assert ends(warm("a"), pooling=none) == [("a", "TooMany")]


def test_one_that_ends_anyway_takes_no_other_s_place() -> None:
    late = warm("z", idle_since=after(-400))
    assert ends(late, warm("a"), warm("b")) == [("z", "IdleTooLong")]
