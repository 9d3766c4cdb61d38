import itertools
import json
import os
import shutil
import sys
from pathlib import Path

from tests.processes import state
from tests.stalls.run import Command, Pauses, names, of_pytest, programs, stalled, stalls
from tests.waiting import PATIENCE, wait_until

PAUSES = Pauses(shortest=0.001, longest=0.002, between=0.001)


def python(program: str, folder: Path) -> Command:
    return Command("a test", (sys.executable, "-c", program), folder)


def test_one_seed_has_one_plan_and_each_stall_is_within_the_bounds() -> None:
    pauses = Pauses(shortest=0.03, longest=0.4, between=0.5)
    first = list(itertools.islice(stalls(7, pauses), 2000))
    assert first == list(itertools.islice(stalls(7, pauses), 2000))
    assert first != list(itertools.islice(stalls(8, pauses), 2000))
    assert all(0.03 <= one.seconds <= 0.4 and 0 <= one.after <= 1.0 for one in first)
    assert all(0 <= one.whom < 1 for one in first)
    # Of 2,000 chances of 0.35 the deviation is 21.
    assert 615 <= sum(one.of_a_thread for one in first) <= 785
    assert 0.47 <= sum(one.after for one in first) / 2000 <= 0.53


def test_a_test_that_passes_and_one_that_fails_are_named_with_their_seed(tmp_path: Path) -> None:
    passed = stalled(python("print('in order')", tmp_path), 3, PAUSES)
    assert passed.passed
    assert str(passed).startswith("ok a test (seed 3, ")
    failed = stalled(python("raise SystemExit('7 in place of 8')", tmp_path), 4, PAUSES)
    assert not failed.passed
    assert str(failed).startswith("FAILED a test (seed 4, ")
    assert "7 in place of 8" in str(failed)


def test_processes_below_a_test_stand_still_and_go_on(tmp_path: Path) -> None:
    # It ends once its child was seen to be stopped, and to go on.
    program = """
import pathlib, subprocess
child = subprocess.Popen(["sleep", "60"])
state = lambda: pathlib.Path(f"/proc/{child.pid}/stat").read_text().rpartition(")")[2].split()[0]
while state() != "t":
    pass
while state() == "t":
    pass
child.kill()
"""
    outcome = stalled(python(program, tmp_path), 5, Pauses(0.01, 0.02, 0.005), deadline=60)
    assert outcome.passed
    assert any(line.startswith("process ") for line in outcome.stalls)


def test_threads_of_a_test_without_processes_stand_still(tmp_path: Path) -> None:
    # It ends once its other thread was stopped by who traces it, and went on.
    program = """
import pathlib, threading
other = threading.Thread(target=threading.Event().wait, daemon=True)
other.start()
stat = pathlib.Path(f"/proc/self/task/{other.native_id}/stat")
state = lambda: stat.read_text().rpartition(")")[2].split()[0]
while state() != "t":
    pass
while state() == "t":
    pass
"""
    outcome = stalled(python(program, tmp_path), 5, Pauses(0.01, 0.02, 0.005), deadline=60)
    assert outcome.passed
    assert any(line.startswith("thread python") for line in outcome.stalls)


def test_a_test_of_one_thread_stands_still_itself_and_its_status_is_kept(tmp_path: Path) -> None:
    # It ends once it has gone on four times.
    program = """
import signal, sys
gone_on = []
signal.signal(signal.SIGCONT, lambda *_: gone_on.append(1))
while len(gone_on) < 4:
    pass
sys.exit(3)
"""
    outcome = stalled(python(program, tmp_path), 5, PAUSES, deadline=60)
    assert not outcome.passed
    assert len(outcome.stalls) > 3
    assert {line.split()[0] for line in outcome.stalls} == {"process"}


def test_a_process_of_any_name_is_named(tmp_path: Path) -> None:
    shutil.copy(os.fsencode(shutil.which("sleep") or ""), os.fsencode(tmp_path) + b"/s\xfc")
    # It ends behind its child's second stall: before the first it may have had no name yet.
    program = """
import os, pathlib, subprocess
child = subprocess.Popen([os.getcwdb() + b"/s\\xfc", "60"])
state = lambda: pathlib.Path(f"/proc/{child.pid}/stat").read_bytes().rpartition(b")")[2].split()[0]
for _ in range(2):
    while state() != b"t":
        pass
    while state() == b"t":
        pass
child.kill()
"""
    outcome = stalled(python(program, tmp_path), 5, PAUSES, deadline=60)
    assert outcome.passed
    assert any(line.startswith("process s\N{REPLACEMENT CHARACTER} (") for line in outcome.stalls)


def test_one_that_hangs_is_ended_with_all_below_it(tmp_path: Path) -> None:
    hangs = Command("a test", ("sh", "-c", "sleep 60 & echo $! > child; wait"), tmp_path)
    outcome = stalled(hangs, 6, Pauses(0, 0, 0.05), deadline=3)
    assert not outcome.passed
    assert "It was not over after 3 s." in str(outcome)
    child = int((tmp_path / "child").read_text())
    # Who was killed and has nobody to ask how it ended yet has no threads, or one that is a zombie.
    wait_until(lambda: state(child) in {None, "Z"}, PATIENCE, "the end of the test's child")


def test_what_cargo_built_tests_into_is_found_with_its_crate() -> None:
    def artifact(folder: str, target: str, is_test: bool, executable: str | None) -> str:
        return json.dumps(
            {
                "reason": "compiler-artifact",
                "manifest_path": f"/x/crates/{folder}/Cargo.toml",
                "target": {"name": target},
                "profile": {"test": is_test},
                "executable": executable,
            }
        )

    messages = [
        artifact("ros2", "publishes", True, "/t/publishes-1"),
        artifact("agent", "bagpipe-agent", False, "/t/bagpipe-agent"),
        artifact("ros2", "bagpipe_ros2", True, None),
        json.dumps({"reason": "build-finished", "success": True}),
    ]
    assert list(programs(messages)) == [
        ("/t/publishes-1", Path("/x/crates/ros2"), "ros2/publishes")
    ]


def test_benches_and_the_sum_of_a_list_are_no_tests() -> None:
    listed = "late::one: test\ntwo: test\nfast: bench\n\n2 tests, 1 benchmark\n"
    assert names(listed) == ["late::one", "two"]


def test_pytest_s_tests_run_one_by_one() -> None:
    file = "tests/unit/stalls/test_freeze.py"
    found = {one.test for one in of_pytest([file, "-k", "ended or depth"])}
    assert found == {
        f"{file}::test_who_has_ended_is_not_stopped",
        f"{file}::test_processes_below_one_are_found_at_any_depth_and_stopped_ones_are_not",
    }
