"""Time zones are files, and the loop opens none."""

import threading
from zoneinfo import ZoneInfo

import pytest

from bagpipe_operator.schedules import cron, zones
from tests.unit.operator.schedules.world import World, name_of


async def test_zones_are_read_beside_the_loop_and_once(monkeypatch: pytest.MonkeyPatch) -> None:
    read: list[tuple[str, bool]] = []

    def read_zone(name: str) -> ZoneInfo | None:
        read.append((name, threading.current_thread() is threading.main_thread()))
        return cron.read_zone(name)

    monkeypatch.setattr(zones, "read_zone", read_zone)
    world = World(timeZone="Europe/Berlin")
    await world.at(1)
    await world.at(2)
    assert read == [("Europe/Berlin", False)]
    assert world.names == [name_of(1), name_of(2)]
    world.change(timeZone="Asia/Kolkata")
    await world.at(3)
    assert read[1:] == [("Asia/Kolkata", False)]
