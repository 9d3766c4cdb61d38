"""Why a driver stops, where several reasons meet, and that it does stop."""

import threading
from pathlib import Path
from typing import Any

import pytest

from bagpipe.driver import job as driver
from bagpipe.driver.journal import Journal
from bagpipe.driver.keep import Keeper
from bagpipe.driver.patience import PATIENCE_SECONDS
from bagpipe.driver.progress import Progress
from bagpipe.plan.case import Case
from bagpipe.plan.made import Plan
from bagpipe.spec import JobFile
from bagpipe.storage import Storage, StorageError
from tests.unit.bagpipe.drivers import World, case, ran
from tests.unit.bagpipe.jobs import make_job

FULL = "pvc://results/x can't be written: No space left on device"


class Pause(threading.Event):
    """Time that passes while the keeper waits; its end fails the test, which would hang."""

    def __init__(self, world: World, most_seconds: float) -> None:
        super().__init__()
        self._world = world
        self._most = most_seconds

    def wait(self, timeout: float | None = None) -> bool:
        self._world.seconds += timeout or 0.0
        assert self._world.seconds <= self._most, "the driver hangs"
        return False


@pytest.fixture
def world(tmp_path: Path) -> World:
    return World(tmp_path)


def unwritable(monkeypatch: pytest.MonkeyPatch, before: Any = lambda: None) -> None:
    def refuse(*_arguments: object) -> None:
        before()
        raise StorageError(FULL)

    monkeypatch.setattr(Journal, "append", refuse)


def too_many(world: World) -> Keeper:
    keeper, _ = world.driver(max_failed=0)
    keeper.take([ran("a", "failed")])
    assert keeper.stop is not None
    assert (keeper.stop.reason, keeper.stop.final) == ("TooManyFailedCases", True)
    return keeper


def test_a_final_stop_with_an_unwritable_journal_ends_by_it(
    world: World, monkeypatch: pytest.MonkeyPatch
) -> None:
    unwritable(monkeypatch)
    keeper = too_many(world)
    keeper.finish(Pause(world, PATIENCE_SECONDS + 1))
    assert keeper.stop is not None
    # Nothing may be committed, which is no end of the job's own.
    assert (keeper.stop.reason, keeper.stop.final) == ("StorageFailed", False)
    assert keeper.stop.message == (
        f"{FULL}; it was tried for 300 s. Before that, TooManyFailedCases: 1 cases failed or"
        " errored, spec.maxFailedCases is 0: the others were not run"
    )
    assert world.seconds <= PATIENCE_SECONDS + 1


def test_a_final_stop_keeps_its_reason_where_the_journal_comes_back(
    world: World, monkeypatch: pytest.MonkeyPatch
) -> None:
    with monkeypatch.context() as patch:

        def comes_back() -> None:
            if world.seconds > 200:
                patch.undo()

        unwritable(patch, before=comes_back)
        keeper = too_many(world)
        keeper.finish(Pause(world, PATIENCE_SECONDS))
    assert keeper.stop is not None
    assert keeper.stop.reason == "TooManyFailedCases"
    assert len(world.names("journal")) == 1


@pytest.mark.parametrize("final", [False, True])
def test_an_interruption_ends_the_wait_for_a_journal(
    world: World, monkeypatch: pytest.MonkeyPatch, final: bool
) -> None:
    keeper = too_many(world) if final else world.driver()[0]
    keeper.take([ran("b")])

    def end_at_seven() -> None:
        if world.seconds >= 7:
            keeper.interrupt()

    unwritable(monkeypatch, before=end_at_seven)
    keeper.finish(Pause(world, 8))
    assert keeper.interrupted


def test_the_first_reason_that_leaves_the_rest_to_another_driver_stays(
    world: World, monkeypatch: pytest.MonkeyPatch
) -> None:
    unwritable(monkeypatch)
    keeper, _ = world.driver(max_failed=0)
    keeper.take([ran("a")])
    keeper.finish(Pause(world, PATIENCE_SECONDS + 1))
    keeper.take([ran("b", "failed")])
    keeper.interrupt()
    assert keeper.stop is not None
    assert keeper.stop.reason == "StorageFailed"
    assert not keeper.interrupted


class OneFails(driver.Place):
    """A plan of two cases, of which one is run and fails."""

    def planned(self, job: JobFile, storage: Storage) -> Plan:  # noqa: ARG002  the base class's signature
        return Plan([case("a"), case("b")], [])

    def run_cases(self, job: JobFile, cases: list[Case], keeper: Keeper) -> None:  # noqa: ARG002
        keeper.take([ran("a", "failed")])


def test_a_job_that_can_t_be_kept_reports_both_reasons_and_commits_nothing(
    world: World, monkeypatch: pytest.MonkeyPatch
) -> None:
    unwritable(monkeypatch)
    monkeypatch.setattr("bagpipe.driver.keep.PATIENCE_SECONDS", 0.0)
    job = make_job({"results": str(world.tmp_path)}, maxFailedCases=0)
    progress = Progress(world.results.folder)
    assert not driver.ended(progress, lambda: driver.run(job, progress, place=OneFails()))
    snapshot = progress.snapshot()
    assert (snapshot["phase"], snapshot["reason"]) == ("Failed", "StorageFailed")
    assert FULL in snapshot["message"]
    assert "TooManyFailedCases" in snapshot["message"]
    assert not world.results.is_committed()


def test_a_storage_that_fails_later_does_not_hide_why_the_work_stopped(
    world: World, monkeypatch: pytest.MonkeyPatch
) -> None:
    unwritable(monkeypatch)
    monkeypatch.setattr("bagpipe.driver.keep.PATIENCE_SECONDS", 0.0)
    place = OneFails()

    def run_cases(job: JobFile, cases: list[Case], keeper: Keeper) -> None:
        OneFails.run_cases(place, job, cases, keeper)

        # From now on nothing can be read either.
        def gone(*_arguments: object) -> None:
            raise StorageError("the storage is gone")

        monkeypatch.setattr(Storage, "exists", gone)

    monkeypatch.setattr(place, "run_cases", run_cases)
    progress = Progress(world.results.folder)
    assert not driver.ended(progress, lambda: driver.run(world.job, progress, place=place))
    snapshot = progress.snapshot()
    assert snapshot["reason"] == "StorageFailed"
    assert snapshot["message"].startswith(FULL)
