"""Rows, journal, manifest: each case counts once, whatever dies between them."""

import tempfile
import threading
from collections.abc import Iterator
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from bagpipe.driver.keep import Keeping, segment_seconds
from bagpipe.driver.patience import patiently
from bagpipe.driver.progress import Progress
from bagpipe.driver.results import results_uri
from bagpipe.driver.row_file import RowFile
from bagpipe.plan.made import Plan
from bagpipe.run.case_run import Row
from bagpipe.storage import Storage, StorageError
from tests.unit.bagpipe.drivers import MISSING, World, case, finish, ran


@pytest.fixture
def world(tmp_path: Path) -> World:
    return World(tmp_path)


@given(st.lists(st.tuples(st.sampled_from("abcdef"), st.integers()), max_size=30))
def test_the_first_row_of_a_case_stays(rows: list[tuple[str, int]]) -> None:
    first: dict[str, int] = {}
    for name, value in rows:
        first.setdefault(name, value)
    with (
        tempfile.TemporaryDirectory(dir="/dev/shm") as folder,
        RowFile(Path(folder, "rows")) as file,
    ):
        added = [file.add({"case": name, "value": value}) for name, value in rows]
        assert sum(added) == len(file) == len(first)
        assert [(row["case"], row["value"]) for row in file.rows()] == sorted(first.items())


def test_a_row_that_could_not_be_kept_does_not_count() -> None:
    with RowFile(Path("/dev/full")) as file:
        with pytest.raises(OSError, match="No space left on device"):
            file.add({"case": "a"})
        assert ("a" in file, len(file), list(file.rows())) == (False, 0, [])


def test_rows_reach_the_journal_after_a_second_and_only_once(world: World) -> None:
    keeper, journal = world.driver()
    keeper.look()
    keeper.take([ran("a"), ran("b")])
    keeper.look()
    assert world.names("journal") == []
    world.seconds = 1.0
    keeper.look()
    keeper.take([ran("b", recorded="cases/b-again.bag")])
    world.seconds = 5.0
    keeper.look()
    finish(keeper)
    assert len(world.names("journal")) == 1
    assert [(row["case"], row["recorded"]) for row in journal.rows()] == [
        ("a", "cases/a.bag"), ("b", "cases/b.bag"),
    ]  # fmt: skip
    assert keeper.progress.snapshot()["cases"]["passed"] == 2


@pytest.mark.parametrize(("elapsed", "seconds"), [(0, 1), (100, 1), (500, 5), (1e6, 30)])
def test_a_long_job_makes_few_segments(elapsed: float, seconds: float) -> None:
    assert segment_seconds(elapsed) == seconds


def test_a_successor_takes_over_what_the_journal_has(world: World) -> None:
    first, _ = world.driver()
    first.take(
        [
            ran("a"),
            ran("b", "errored", reason="StackExited"),
            ran("moved"),
            ran("new", bag_version="9-2"),
        ]
    )
    finish(first)
    second, _ = world.driver()
    second.resume(
        Plan([case("a"), case("b"), case("c"), case("moved", start=21), case("new")], [MISSING])
    )
    assert [name for name in ("a", "b", "c", "moved", "new") if name in second.rows] == ["a", "b"]
    counts = second.progress.snapshot()["cases"]
    assert (counts["passed"], counts["errored"]) == (1, 2)  # the missing bag is counted too
    second.take([ran("c"), ran("moved", window=[10, 21, 30])])
    finish(second)
    assert len(world.names("journal")) == 2


def test_a_segment_that_is_damaged_is_named(world: World) -> None:
    with world.storage.create(f"{results_uri(world.job)}/journal/0001-x-000000.jsonl") as file:
        file.write(b'{"case": "a"}\n{"cas')
    _, journal = world.driver()
    rows: Iterator[Row] = journal.rows()
    assert next(rows)["case"] == "a"
    with pytest.raises(StorageError, match=r"0001-x-000000\.jsonl line 2 is no row"):
        next(rows)


def test_an_interrupted_driver_journals_what_it_has_and_tries_that_once(
    world: World, monkeypatch: pytest.MonkeyPatch
) -> None:
    keeper, journal = world.driver()
    keeper.look()
    keeper.take([ran("a")])
    keeper.interrupt()
    assert keeper.interrupted
    finish(keeper)
    assert [row["case"] for row in journal.rows()] == ["a"]
    keeper.take([ran("b")])

    def full(*_arguments: object) -> object:
        raise StorageError("pvc://results/j can't be written: No space left on device")

    monkeypatch.setattr(Storage, "create", full)
    finish(keeper)  # does not wait
    monkeypatch.undo()
    finish(keeper)
    assert [row["case"] for row in journal.rows()] == ["a", "b"]


def test_a_keeper_that_fails_cancels_the_work_and_what_was_taken_is_journaled(
    world: World,
) -> None:
    keeper, journal = world.driver()
    handed, cancelled = [[ran("a")]], threading.Event()

    def running() -> int:
        raise KeyError("a fault of ours")

    def work() -> None:
        with Keeping(keeper, lambda: handed.pop() if handed else [], running, cancelled.set):
            assert cancelled.wait(60)
            handed.append([ran("b")])  # of a task that ended before it could be cancelled
            raise RuntimeError("cancelled")

    with pytest.raises(KeyError, match="a fault of ours"):
        work()
    finish(keeper)
    assert [row["case"] for row in journal.rows()] == ["a", "b"]
    assert keeper.stop is None


def test_a_keeper_that_fails_is_reported_also_where_nothing_can_be_cancelled(world: World) -> None:
    tried = threading.Event()

    def running() -> int:
        raise KeyError("a fault of ours")

    def cancel() -> None:
        tried.set()
        raise ConnectionRefusedError(111, "Connection refused")

    def work() -> None:
        with Keeping(world.driver()[0], list, running, cancel):
            assert tried.wait(60)

    with pytest.raises(KeyError, match="a fault of ours"):
        work()


def test_an_end_that_is_the_job_s_own_is_not_made_an_interruption(world: World) -> None:
    keeper, _ = world.driver(max_failed=0)
    keeper.take([ran("a", "failed")])
    keeper.interrupt()
    assert keeper.stop is not None
    assert (keeper.stop.reason, keeper.interrupted) == ("TooManyFailedCases", False)


def test_a_driver_that_was_replaced_stops(world: World) -> None:
    keeper, _ = world.driver()
    keeper.look()
    other, journal = world.driver()
    world.results.commit(other.rows, other.progress, journal.driver)
    world.seconds = 14.9
    keeper.look()
    assert keeper.stop is None
    world.seconds = 15.0
    keeper.look()
    assert keeper.stop is not None
    assert (keeper.stop.reason, keeper.stop.final) == ("Superseded", False)


def test_too_many_failed_cases_stop_the_job(world: World) -> None:
    keeper, _ = world.driver(max_failed=1)
    keeper.take([ran("a", "failed"), ran("b", "invalid"), ran("c")])
    assert keeper.stop is None
    keeper.take([ran("d", "errored", reason="StackExited")])
    assert keeper.stop is not None
    assert (keeper.stop.reason, keeper.stop.final) == ("TooManyFailedCases", True)
    assert keeper.stop.message.startswith("2 cases failed or errored, spec.maxFailedCases is 1")


def test_a_full_volume_is_waited_for(world: World, monkeypatch: pytest.MonkeyPatch) -> None:
    keeper, journal = world.driver()
    keeper.look()
    keeper.take([ran("a")])
    create = Storage.create

    def full(*_arguments: object) -> object:
        raise StorageError("pvc://results/j can't be written: No space left on device")

    monkeypatch.setattr(Storage, "create", full)
    for second in range(1, 300, 60):
        world.seconds = float(second)
        keeper.look()
    assert keeper.stop is None
    assert "No space left" in keeper.progress.snapshot()["warning"]
    monkeypatch.setattr(Storage, "create", create)
    world.seconds = 299.0
    keeper.look()
    assert [row["case"] for row in journal.rows()] == ["a"]
    assert keeper.progress.snapshot()["warning"] == ""


def test_a_volume_that_stays_full_ends_the_job(
    world: World, monkeypatch: pytest.MonkeyPatch
) -> None:
    keeper, _ = world.driver()
    keeper.look()
    keeper.take([ran("a")])

    def full(*_arguments: object) -> object:
        raise StorageError("pvc://results/j can't be written: No space left on device")

    monkeypatch.setattr(Storage, "create", full)
    for second in range(1, 400, 30):
        world.seconds = float(second)
        keeper.look()
    assert keeper.stop is not None
    assert (keeper.stop.reason, keeper.stop.final) == ("StorageFailed", False)
    finish(keeper)  # does not wait any longer


def test_patience_ends() -> None:
    seconds = [0.0]
    tries = []

    def action() -> str:
        tries.append(seconds[0])
        if len(tries) <= 3:
            raise StorageError("full")
        return "done"

    def pause(length: float) -> None:
        seconds[0] += length

    progress = Progress("pvc://results/r")
    assert patiently(action, progress, lambda: seconds[0], pause) == "done"
    assert tries == [0, 2, 4, 6]

    def never() -> str:
        tries.append(seconds[0])
        raise StorageError("full")

    begun = seconds[0]
    with pytest.raises(StorageError, match="full"):
        patiently(never, progress, lambda: seconds[0], pause)
    assert seconds[0] - begun == 300
