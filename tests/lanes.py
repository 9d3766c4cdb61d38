"""Which tests share a process where several run beside each other, and which of them begin first.

What takes longest comes first, by what it took the last time on this machine, or on another one
(lanes.toml): else one process would still be at it when the others have nothing left to do.
"""

import os
import tomllib
from collections.abc import Iterable, Mapping
from contextlib import suppress
from pathlib import Path

import pytest
from xdist.remote import Producer
from xdist.scheduler import LoadScopeScheduling
from xdist.workermanage import WorkerController

# Folders whose tests share servers that are dear to start; elsewhere those of a file stay together.
# The first that a file is in counts: operators have an API server of their own, for its time.
SHARING = (
    "tests/integration/binpipe",
    "tests/integration/control_plane/operators",
    "tests/integration/control_plane",
    "tests/integration/storage",
)


# What lanes took on a machine with two cores, in seconds, for one on which they never ran.
ELSEWHERE = Path(__file__).with_suffix(".toml")


def elsewhere() -> dict[str, float]:
    """What lanes took on another machine."""
    seconds: dict[str, float] = tomllib.loads(ELSEWHERE.read_text())["seconds"]
    return seconds


def lane(file: str) -> str:
    """What runs in one process with a file of tests; paths from the project's root."""
    return next((folder for folder in SHARING if file.startswith(f"{folder}/")), file)


def lane_of(test: str) -> str:
    """The lane of a test by its node id."""
    return lane(test.partition("::")[0])


def expected(tests: Mapping[str, int], took: Mapping[str, float]) -> dict[str, float]:
    """Seconds that each lane may take, of how many tests each has and what it took the last time.

    One that never ran takes as long a test as all others together.
    """
    known = [name for name in tests if name in took]
    count = sum(tests[name] for name in known)
    each = sum(took[name] for name in known) / count if count else 1.0
    return {name: took.get(name, number * each) for name, number in tests.items()}


class Times:
    """What the lanes took the last time, a file each: several runs may write beside each other."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder

    def read(self, lanes: Iterable[str]) -> dict[str, float]:
        """Of those that are known, in seconds."""
        found = {}
        for name in lanes:
            with suppress(OSError, ValueError):
                found[name] = float(self._file(name).read_text())
        return found

    def keep(self, took: Mapping[str, float]) -> None:
        """That they can't be kept is no fault of the tests."""
        with suppress(OSError):
            self._folder.mkdir(parents=True, exist_ok=True)
            for name, seconds in took.items():
                partly = self._file(f"{name}.{os.getpid()}")
                partly.write_text(f"{seconds:.1f}")
                partly.replace(self._file(name))

    def _file(self, name: str) -> Path:
        return self._folder / name.replace("/", "-")


class Lanes(LoadScopeScheduling):  # type: ignore[misc]  # xdist has no types
    """Gives a process the tests of a lane; those that take longest first."""

    def __init__(self, config: pytest.Config, log: Producer, times: Times) -> None:
        super().__init__(config, log)
        self._times = times
        self._expected: dict[str, float] = {}

    def _split_scope(self, nodeid: str) -> str:
        return lane_of(nodeid)

    def _assign_work_unit(self, node: WorkerController) -> None:
        if not self._expected:
            tests = {name: len(unit) for name, unit in self.workqueue.items()}
            self._expected = expected(tests, elsewhere() | self._times.read(tests))
        # A lane comes back into the queue where a process has died meanwhile.
        longest = max(self.workqueue, key=lambda name: self._expected.get(name, 0.0))
        self.workqueue.move_to_end(longest, last=False)
        super()._assign_work_unit(node)


class Clocking:
    """A plugin of the process that hands out the lanes: keeps what each took."""

    def __init__(self, times: Times) -> None:
        self._times = times
        self._took: dict[str, float] = {}

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        name = lane_of(report.nodeid)
        self._took[name] = self._took.get(name, 0.0) + report.duration

    def pytest_sessionfinish(self) -> None:
        self._times.keep(self._took)
