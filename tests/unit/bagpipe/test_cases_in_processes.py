"""A driver without Spark: rows once each, processes that end with a case, a stop, SIGTERM."""

import dataclasses
import multiprocessing
import os
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path

import pytest

from bagpipe.driver import job as driver
from bagpipe.driver.cases_in_processes import run_cases
from bagpipe.driver.keep import Keeper
from bagpipe.driver.progress import Progress
from bagpipe.plan.case import Case
from bagpipe.run.case_run import Row, RunContext
from tests.unit.bagpipe.fake_agent import FakeAgent, well_behaved
from tests.unit.bagpipe.jobs import make_row
from tests.unit.bagpipe.places import By
from tests.unit.bagpipe.test_driver_over_spark import World
from tests.waiting import PATIENCE, wait_until


@pytest.fixture
def world(tmp_path: Path) -> World:
    return World(tmp_path)


def marks_of(context: RunContext) -> Path:
    return Path(context.volumes["results"])


def dies(case: Case, context: RunContext, starts: int) -> Row:
    """As where the kernel's OOM killer ends it: no exception and no row."""
    (marks_of(context) / f"{case.id}.{starts}").touch()
    os.kill(os.getpid(), signal.SIGKILL)
    raise AssertionError


def dies_twice(case: Case, _context: RunContext, starts: int) -> Row:
    if case.id == "b-0000" and starts < 3:
        os._exit(137)
    return make_row(case.id, starts=starts)


def has_a_defect(case: Case, _context: RunContext, _starts: int) -> Row:
    raise LookupError(f"no {case.id} anywhere")


def fails(case: Case, _context: RunContext, _starts: int) -> Row:
    return make_row(case.id, outcome="failed", reason="CriterionFailed")


def names_its_process(case: Case, _context: RunContext, _starts: int) -> Row:
    return make_row(case.id) | {"attempts": os.getpid()}


def waits(case: Case, context: RunContext, _starts: int) -> Row:
    """The first one ends, the others never."""
    while case.id != "a-0000":
        mark = marks_of(context) / case.id
        mark.with_suffix(".part").write_text(str(os.getpid()))
        mark.with_suffix(".part").rename(mark)
        time.sleep(3600)
    return make_row(case.id)


def test_a_folder_of_temporary_files_with_a_long_path_leaves_room_for_sockets(
    tmp_path: Path,
) -> None:
    """Whatever a process has asked for its folder once, it remembers: so one of its own."""
    program = (
        "import multiprocessing, tempfile\n"
        "from bagpipe.driver import slot_server\n"
        "process = slot_server.forks().Process(target=print, args=('ran',))\n"
        "process.start()\n"
        "process.join()\n"
        "print(process.exitcode, tempfile.gettempdir(), multiprocessing.util.get_temp_dir())\n"
    )
    for name in ("a", "b" * 120):
        folder = tmp_path / name
        folder.mkdir()
        done = subprocess.run(
            [sys.executable, "-c", program], env=os.environ | {"TMPDIR": str(folder)},
            capture_output=True, text=True, timeout=60, check=True,
        )  # fmt: skip
        printed, (status, usual, own) = done.stdout.split()[0], done.stdout.split()[1:]
        assert (printed, status, usual) == ("ran", "0", str(folder))
        assert len(own) <= 107 - len("/listener-12345678")


def test_cases_come_back_once_each(world: World) -> None:
    keeper = world.keeper()
    with FakeAgent(world.slot, *[well_behaved()] * 6):
        run_cases(world.cases, world.context, 1, keeper)
    rows = list(world.rows.rows())
    assert [each["case"] for each in rows] == [f"{name}-0000" for name in "abcdef"]
    assert {each["outcome"] for each in rows} == {"passed"}
    assert all(row["ran_on"]["cpus"] for row in rows)
    assert keeper.progress.finish()
    assert keeper.progress.snapshot()["cases"]["passed"] == 6


def test_there_is_one_process_for_each_slot_and_none_of_them_is_left(world: World) -> None:
    keeper = world.keeper()
    run_cases(world.cases, world.context, 2, keeper, names_its_process)
    pids = {row["attempts"] for row in world.rows.rows()}
    assert len(pids) in {1, 2}
    assert os.getpid() not in pids
    assert [pid for pid in pids if Path(f"/proc/{pid}").exists()] == []
    assert multiprocessing.active_children() == []


def test_a_case_that_takes_its_process_with_it_is_given_up_after_four_starts(
    world: World,
) -> None:
    keeper = world.keeper()
    run_cases(world.cases[:1], world.context, 2, keeper, dies)
    (row,) = world.rows.rows()
    assert (row["outcome"], row["reason"]) == ("errored", "ExecutorLost")
    assert (row["starts"], row["attempts"], row["discarded"]) == (4, 0, [])
    assert {f"a-0000.{n}" for n in (1, 2, 3, 4)} <= {
        path.name for path in marks_of(world.context).iterdir()
    }
    lost = row["evidence"]["starts"]
    assert [start["error"] for start in lost] == ["its process ended with signal 9"] * 4
    assert {start["executor"] for start in lost} == {"driver"}


def test_the_others_run_on_and_a_row_says_how_often_its_case_was_started(world: World) -> None:
    run_cases(world.cases, world.context, 2, world.keeper(), dies_twice)
    starts = {row["case"]: row["starts"] for row in world.rows.rows()}
    assert starts == {f"{name}-0000": 3 if name == "b" else 1 for name in "abcdef"}


def test_a_defect_of_ours_is_in_the_row_of_its_case(world: World) -> None:
    run_cases(world.cases[:1], world.context, 1, world.keeper(), has_a_defect)
    (row,) = world.rows.rows()
    errors = [start["error"] for start in row["evidence"]["starts"]]
    assert len(errors) == 4
    assert all(error.endswith("LookupError: no a-0000 anywhere\n") for error in errors)


def test_after_too_many_failures_no_case_is_begun(world: World) -> None:
    many = [dataclasses.replace(world.cases[0], id=f"case-{n:05d}") for n in range(100_000)]
    keeper = world.keeper(max_failed=0)
    run_cases(many, world.context, 2, keeper, fails)
    assert keeper.stop is not None
    assert (keeper.stop.reason, keeper.stop.final) == ("TooManyFailedCases", True)
    assert 0 < len(world.rows) < len(many)


def test_no_slot_goes_on_with_its_case_when_its_driver_was_killed(tmp_path: Path) -> None:
    """Its parent is the server that forked it, which a slot that lives keeps alive."""
    program = (
        "import sys\n"
        "from pathlib import Path\n"
        "from bagpipe.driver.cases_in_processes import run_cases\n"
        "from tests.unit.bagpipe.test_cases_in_processes import waits\n"
        "from tests.unit.bagpipe.test_driver_over_spark import World\n"
        "world = World(Path(sys.argv[1]))\n"
        "run_cases(world.cases[1:2], world.context, 1, world.keeper(), waits)\n"
    )
    mark = tmp_path / "results/b-0000"
    with subprocess.Popen([sys.executable, "-c", program, str(tmp_path)]) as of_driver:
        try:
            wait_until(mark.exists, PATIENCE, "the case is not begun")
        finally:
            of_driver.kill()
    slot = Path("/proc", mark.read_text())
    try:
        wait_until(lambda: not slot.exists(), PATIENCE, "its slot outlives the driver")
    finally:
        if slot.exists():
            os.kill(int(slot.name), signal.SIGKILL)


def test_an_interrupted_driver_ends_its_cases_and_keeps_what_is_done(world: World) -> None:
    marks = marks_of(world.context)

    def run(cases: list[Case], keeper: Keeper) -> None:
        threading.Thread(target=interrupt, args=(keeper,), daemon=True).start()
        run_cases(cases, world.context, 2, keeper, waits)

    def interrupt(keeper: Keeper) -> None:
        def others_wait() -> bool:
            passed: int = keeper.progress.snapshot()["cases"]["passed"]
            return passed == 1 and all((marks / f"{name}-0000").exists() for name in "bc")

        try:
            wait_until(others_wait, PATIENCE, "no two cases run beside the one that ended")
        finally:
            os.kill(os.getpid(), signal.SIGTERM)

    interruption, progress = driver.Interruption(), Progress(world.results.folder)
    before = signal.signal(signal.SIGTERM, interruption)
    try:
        with pytest.raises(SystemExit) as ended:
            driver.run(world.job, progress, By(run), interruption)
    finally:
        signal.signal(signal.SIGTERM, before)
    assert ended.value.code == 143
    assert [row["case"] for row in world.journal.rows()] == ["a-0000"]
    assert not world.results.is_committed()
    left = [int((marks / f"{name}-0000").read_text()) for name in "bc"]
    assert [pid for pid in left if Path(f"/proc/{pid}").exists()] == []
