"""Which tests share a process, and in which order the lanes begin."""

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from xdist.remote import Producer

from tests.lanes import Clocking, Lanes, Times, elsewhere, expected, lane

ROOT = Path(__file__).parents[3]


@pytest.mark.parametrize(
    ("place", "expected"),
    [
        ("tests/integration/control_plane/test_crd.py", "tests/integration/control_plane"),
        (
            "tests/integration/control_plane/operators/test_life.py",
            "tests/integration/control_plane/operators",
        ),
        ("tests/integration/test_lockstep.py", "tests/integration/test_lockstep.py"),
        ("tests/e2e/test_scenes.py", "tests/e2e/test_scenes.py"),
        ("tests/unit/cli/test_run.py", "tests/unit/cli/test_run.py"),
    ],
)
def test_tests_that_share_servers_are_in_one_lane(place: str, expected: str) -> None:
    assert lane(place) == expected


def test_what_never_ran_takes_as_long_a_test_as_all_others() -> None:
    tests = {"a": 2, "b": 6, "new": 10}
    assert expected(tests, {"a": 30.0, "b": 2.0, "gone": 900.0}) == {
        "a": 30.0, "b": 2.0, "new": 40.0,
    }  # fmt: skip
    assert expected(tests, {}) == {"a": 2.0, "b": 6.0, "new": 10.0}
    assert expected({}, {"gone": 1.0}) == {}


def test_what_took_long_elsewhere_is_a_lane_of_this_project() -> None:
    known = elsewhere()
    assert [name for name in known if not (ROOT / name).exists()] == []
    files = {name: name if name.endswith(".py") else f"{name}/test_any.py" for name in known}
    assert [name for name, file in files.items() if lane(file) != name] == []
    assert known["tests/integration/control_plane"] > 60


def test_times_are_kept_and_what_cannot_be_read_is_unknown(tmp_path: Path) -> None:
    times = Times(tmp_path / "lanes")
    assert times.read(["tests/a.py"]) == {}
    times.keep({"tests/a.py": 1.26, "tests/b": 7.0})
    times.keep({"tests/b": 8.0})
    (tmp_path / "lanes/tests-c.py").write_text("")
    names = ["tests/a.py", "tests/b", "tests/c.py", "tests/d.py"]
    assert times.read(names) == {"tests/a.py": 1.3, "tests/b": 8.0}
    assert {path.name for path in (tmp_path / "lanes").iterdir()} == {
        "tests-a.py", "tests-b", "tests-c.py",
    }  # fmt: skip


def test_where_times_cannot_be_kept_nothing_fails(tmp_path: Path) -> None:
    (tmp_path / "lanes").write_text("a file")
    Times(tmp_path / "lanes").keep({"tests/a.py": 1.0})
    assert Times(tmp_path / "lanes").read(["tests/a.py"]) == {}


class Process:
    """A worker of xdist's, as far as its scheduler uses one."""

    def __init__(self) -> None:
        self.gateway = SimpleNamespace(id="gw0", spec="popen")
        self.shutting_down = False
        self.given: list[int] = []

    def send_runtest_some(self, numbers: list[int]) -> None:
        self.given += numbers

    def shutdown(self) -> None:
        self.shutting_down = True


def order(tests: list[str], times: Times) -> list[str]:
    """That in which one process gets the tests."""
    options = SimpleNamespace(tx=["popen"], loadscopereorder=True, maxfail=0)
    config: Any = SimpleNamespace(option=options, getvalue=lambda _name: ["popen"])
    lanes = Lanes(config, Producer("tests", enabled=False), times)
    process: Any = Process()
    lanes.add_node(process)
    lanes.add_node_collection(process, tests)
    lanes.schedule()
    while len(process.given) < len(tests):
        done = len(process.given)
        for number in process.given[:done]:
            if not lanes.assigned_work[process][lane(tests[number].partition("::")[0])][
                tests[number]
            ]:
                lanes.mark_test_complete(process, number)
        assert len(process.given) > done
    return [tests[number] for number in process.given]


def test_the_lane_that_took_longest_is_first_and_the_most_tests_are_where_none_is_known(
    tmp_path: Path,
) -> None:
    tests = ["a.py::1", *(f"b.py::{n}" for n in range(5)), *(f"c.py::{n}" for n in range(3))]
    a, b, c = tests[:1], tests[1:6], tests[6:]
    times = Times(tmp_path)
    assert order(tests, times) == [*b, *c, *a]
    times.keep({"a.py": 60.0, "b.py": 2.0, "c.py": 3.0})
    assert order(tests, times) == [*a, *c, *b]


def test_a_lane_took_what_its_tests_did_with_what_was_before_and_behind_them(
    tmp_path: Path,
) -> None:
    clocking = Clocking(Times(tmp_path))
    storage = "tests/integration/storage"
    for test, seconds in (("a.py::1", 1.0), ("a.py::1", 2.5), (f"{storage}/x.py::1", 4.0)):
        report: Any = SimpleNamespace(nodeid=test, duration=seconds)
        clocking.pytest_runtest_logreport(report)
    clocking.pytest_sessionfinish()
    assert Times(tmp_path).read(["a.py", storage]) == {"a.py": 3.5, storage: 4.0}
