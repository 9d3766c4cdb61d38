"""Which tests share a process when several run beside each other, and what each of them took."""

import json
import os
from collections.abc import Generator
from pathlib import Path

import pytest

from tests.times import Meter

TESTS = Path(__file__).parent
# Folders whose tests share servers that are dear to start; elsewhere those of a file stay together.
SHARING = ("integration/control_plane", "integration/storage", "e2e")
TIMES = "BAGPIPE_TEST_TIMES"


def lane(path: Path) -> str:
    """The name of the group that pytest-xdist (--dist loadgroup) gives to one process."""
    place = path.relative_to(TESTS).as_posix()
    return next((folder for folder in SHARING if place.startswith(f"{folder}/")), place)


@pytest.hookimpl(tryfirst=True)  # xdist then reads the groups
def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    for item in items:
        item.add_marker(pytest.mark.xdist_group(lane(item.path)))


@pytest.hookimpl(wrapper=True)
def pytest_runtest_protocol(item: pytest.Item) -> Generator[None, bool, bool]:
    meter = Meter()
    try:
        return (yield)
    finally:
        if path := os.environ.get(TIMES):
            name = item.nodeid.removesuffix(f"@{lane(item.path)}")
            took = {"test": name, **meter.read()}
            with Path(path).open("a") as file:
                file.write(json.dumps(took) + "\n")
