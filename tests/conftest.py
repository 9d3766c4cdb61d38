"""Tests in lanes beside each other, and what each of them took."""

import json
import os
import signal
from collections.abc import Generator
from pathlib import Path

import pytest
from xdist.remote import Producer

from tests.cached import cache
from tests.lanes import Clocking, Lanes, Times
from tests.times import Meter

TIMES = "BAGPIPE_TEST_TIMES"


def pytest_configure() -> None:
    """What a shell runs in its background ignores Ctrl-C, and so would all that tests start."""
    if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
        signal.signal(signal.SIGINT, signal.default_int_handler)


@pytest.hookimpl(optionalhook=True)
def pytest_xdist_make_scheduler(config: pytest.Config, log: Producer) -> Lanes:
    """For `--dist loadscope`: loadgroup groups nothing with pytest 9.2 (pytest-xdist#1386)."""
    times = Times(cache() / "lanes")
    config.pluginmanager.register(Clocking(times))
    return Lanes(config, log, times)


def pytest_make_parametrize_id(val: object, argname: str) -> str | None:
    """Bytes that can't be read name no test: what is packed may hold the second of its packing,
    and then two processes that collect the same tests find them under different names."""
    unreadable = isinstance(val, bytes) and not (val.isascii() and val.decode().isprintable())
    return argname if unreadable else None


@pytest.hookimpl(wrapper=True)
def pytest_runtest_protocol(item: pytest.Item) -> Generator[None, bool, bool]:
    meter = Meter()
    try:
        return (yield)
    finally:
        if path := os.environ.get(TIMES):
            took = {"test": item.nodeid, **meter.read()}
            with Path(path).open("a") as file:
                file.write(json.dumps(took) + "\n")
