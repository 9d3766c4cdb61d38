"""Going on from a job that has ended: what is taken over, and what is refused."""

import dataclasses
import json
import threading
from pathlib import Path
from typing import Any

import pytest

from bagpipe.driver import journal as journal_module
from bagpipe.driver import keep
from bagpipe.driver.earlier import CannotResumeError, passed_rows
from bagpipe.driver.journal import Journal
from bagpipe.driver.keep import Keeper
from bagpipe.driver.progress import Progress
from bagpipe.driver.results import Results
from bagpipe.driver.row_file import RowFile
from bagpipe.plan.case import Case
from bagpipe.plan.conditions import Conditions
from bagpipe.plan.fragments import Window
from bagpipe.plan.made import Plan, Unplanned
from bagpipe.run.case_run import Row, unplanned_row
from bagpipe.spec import EarlierResults
from bagpipe.storage import Storage, StorageError
from tests.unit.bagpipe.jobs import make_job, make_row

MISSING = Unplanned("lost", "pvc://recordings/lost.bag", "BagMissing", "no file at lost.bag")
FOLDER = "pvc://results/out/old/uid-old"


def case(name: str) -> Case:
    return Case(name, "pvc://recordings/a.bag", "9-1", Window(10, 20, 30), [], [(0, 9)], 1)


PLAN = Plan([case(name) for name in "abcd"], [MISSING])


def ran(name: str, outcome: str = "passed", **changed: Any) -> Row:
    row = make_row(name, outcome, **({"window": [10, 20, 30], "bag_version": "9-1"} | changed))
    return row | {"bag": "pvc://recordings/a.bag"}


class World:
    """The results folder of a job that has ended."""

    def __init__(self, tmp_path: Path) -> None:
        self.tmp_path = tmp_path
        self.storage = Storage({"results": str(tmp_path)})
        self.earlier = EarlierResults(job="old", results=FOLDER, cases=5)

    def journal(self, *rows: Row) -> None:
        Journal(self.storage, FOLDER, 1).append(rows)

    def publish(self, *rows: Row) -> None:
        with self.storage.create(f"{FOLDER}/results.jsonl") as file:
            for row in rows:
                file.write(json.dumps(row).encode() + b"\n")

    def taken(self, planned: Plan = PLAN) -> list[Row]:
        return list(passed_rows(self.earlier, planned, self.storage))


@pytest.fixture
def world(tmp_path: Path) -> World:
    return World(tmp_path)


ROWS = [
    ran("a"), ran("b", "failed", reason="X"), ran("c", "errored", reason="X"),
    ran("d", recorded=["cases/d.0.txt", "cases/d.1.txt"]), unplanned_row(MISSING),
]  # fmt: skip


@pytest.mark.parametrize("where", ["journal", "publish"])
def test_only_what_passed_is_taken_over_with_the_place_of_its_recordings(
    world: World, where: str
) -> None:
    getattr(world, where)(*ROWS)
    taken = world.taken()
    assert [(row["case"], row["recorded"], row["ran_in"]) for row in taken] == [
        ("a", f"{FOLDER}/cases/a.bag", "old"),
        ("d", [f"{FOLDER}/cases/d.0.txt", f"{FOLDER}/cases/d.1.txt"], "old"),
    ]
    assert taken[0]["result"] == ROWS[0]["result"]


def test_neither_a_bag_without_a_case_nor_a_case_s_second_row_hides_what_comes_later(
    world: World,
) -> None:
    world.publish(unplanned_row(MISSING), ran("a"), ran("a", "failed", reason="X"), ran("b"))
    assert [row["case"] for row in world.taken()] == ["a", "b"]


def test_what_was_taken_over_once_keeps_its_origin(world: World) -> None:
    world.publish(ran("a", recorded="pvc://results/out/oldest/u/cases/a.bag", ran_in="oldest"))
    (row,) = world.taken()
    assert (row["recorded"], row["ran_in"]) == (
        "pvc://results/out/oldest/u/cases/a.bag", "oldest",
    )  # fmt: skip


def test_rows_longer_than_a_piece_are_read_whole(world: World) -> None:
    long = [ran(name, message="x" * 900_000) for name in "abcd"]
    world.publish(*long)
    assert [len(row["message"]) for row in world.taken()] == [900_000] * 4


@pytest.mark.parametrize(
    ("planned", "sentence"),
    [
        (Plan(PLAN.cases[:3], []), "planned 5 cases and this one has 3: its bags have changed"),
        (
            Plan([dataclasses.replace(case(n), bag_version="9-2") for n in "abcd"], [MISSING]),
            r"case a of job old was made of pvc://recordings/a.bag as it was then",
        ),
        (Plan([case(name) for name in "bcde"], [MISSING]), "case a of job old was made of"),
    ],
)
def test_another_plan_is_refused(world: World, planned: Plan, sentence: str) -> None:
    world.publish(*ROWS)
    with pytest.raises(CannotResumeError, match=sentence):
        world.taken(planned)


def test_results_that_are_gone_or_broken_are_refused(world: World) -> None:
    with pytest.raises(CannotResumeError, match=r"holds neither results\.jsonl nor a journal"):
        world.taken()
    with world.storage.create(f"{FOLDER}/results.jsonl") as file:
        file.write(b'{"case": ')
    with pytest.raises(CannotResumeError, match=r"can't be read: .*line 1 is no row"):
        world.taken()


def test_the_manifest_of_the_job_that_goes_on_counts_both(world: World, tmp_path: Path) -> None:
    world.publish(*ROWS)
    job = make_job({"results": str(tmp_path)})
    results = Results(job, world.storage)
    journal = Journal(world.storage, results.folder, 1)
    progress = Progress(results.folder)
    progress.begin(5)
    with RowFile(tmp_path / "rows") as rows:
        keeper = Keeper(progress, rows, journal)
        assert keeper.take_over(passed_rows(world.earlier, PLAN, world.storage)) == 2
        assert [name for name in "abcd" if name in rows] == ["a", "d"]
        keeper.take([ran("b"), ran("c"), unplanned_row(MISSING)])
        keeper.finish(threading.Event())
        manifest = results.commit(rows, progress, journal.driver)
        results.publish(manifest, rows.rows, journal)
    assert manifest["counts"]["passed"] == 4
    assert [entry["recorded"] for entry in manifest["cases"]][:2] == [
        f"{FOLDER}/cases/a.bag", "cases/b.bag",
    ]  # fmt: skip
    lines = (tmp_path / "out/drive/uid-1/results.jsonl").read_text().splitlines()
    assert [json.loads(line).get("ran_in") for line in lines] == ["old", None, None, "old", None]


def test_rows_of_a_large_job_are_journaled_as_they_are_taken_over(
    world: World, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """All at once would be in memory, and a segment that no driver can read again."""
    monkeypatch.setattr(keep, "_ROWS_AT_ONCE", 2)
    journal = Journal(world.storage, FOLDER, 1)
    with RowFile(tmp_path / "rows") as rows:
        keeper = Keeper(Progress(FOLDER), rows, journal)
        assert keeper.take_over(ran(name) for name in "abcde") == 5
        assert [row["case"] for row in journal.rows()] == list("abcd")
        keeper.finish(threading.Event())
    assert [row["case"] for row in journal.rows()] == list("abcde")


def test_what_was_kept_of_many_rows_is_not_written_again_where_the_rest_fails(
    world: World, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A volume that is filling would fill with the same rows again and again."""
    journal, append = Journal(world.storage, FOLDER, 1), Journal.append
    monkeypatch.setattr(journal_module, "_SEGMENT_BYTES", 1)
    room = [2, 1, 2]

    def filling(mine: Journal, rows: list[Row]) -> int:
        if room[0] == 0:
            del room[0]
            raise StorageError("no space left")
        room[0] -= 1
        return append(mine, rows)

    monkeypatch.setattr(Journal, "append", filling)
    with RowFile(tmp_path / "rows") as rows:
        keeper = Keeper(Progress(FOLDER), rows, journal)
        keeper.take([ran(name) for name in "abcde"])
        pause = threading.Event()
        pause.set()
        keeper.finish(pause)
    assert room == [0]
    assert [row["case"] for row in Journal(world.storage, FOLDER, 2).rows()] == list("abcde")


FAILED = ran("a", "failed", reason="CriterionFailed")


@pytest.mark.parametrize("rows", [(FAILED, ran("a")), (ran("a"), FAILED)])
def test_what_the_job_itself_counts_as_failed_is_not_taken_over_as_passed(
    tmp_path: Path, rows: tuple[Row, Row]
) -> None:
    world = World(tmp_path)
    folder = world.earlier.results
    # Attempt 1 was cut off from the API server and went on; its successor ran the case as well.
    for attempt, row in enumerate(rows, start=1):
        Journal(world.storage, folder, attempt).append([row])
    with RowFile(tmp_path / "rows") as kept:
        keeper = Keeper(Progress(folder), kept, Journal(world.storage, folder, 3))
        keeper.resume(PLAN)
        assert [row["outcome"] for row in kept.rows() if row["case"] == "a"] == ["failed"]
        counts = keeper.progress.snapshot()["cases"]
        assert (counts["passed"], counts["failed"]) == (0, 1)
        keeper.finish(threading.Event())
    world2 = World(tmp_path)
    assert [row["case"] for row in world2.taken()] == []


@pytest.mark.parametrize(
    ("rows", "counts"),
    [
        ("passed errored", "passed"),  # an errored one says nothing of the stack
        ("errored passed", "passed"),
        ("passed invalid", "invalid"),
        ("invalid failed passed", "failed"),
    ],
)
def test_of_the_rows_of_drivers_that_worked_at_once_the_worst_counts(
    world: World, rows: str, counts: str
) -> None:
    for attempt, outcome in enumerate(rows.split(), start=1):
        Journal(world.storage, FOLDER, attempt).append([ran("b", outcome)])
    with RowFile(world.tmp_path / "rows") as kept:
        Keeper(Progress(FOLDER), kept, Journal(world.storage, FOLDER, 9)).resume(PLAN)
        assert [row["outcome"] for row in kept.rows() if row["case"] == "b"] == [counts]
    assert bool(world.taken()) == (counts == "passed")


def test_results_that_can_t_even_be_looked_for_are_a_refusal(
    world: World, monkeypatch: pytest.MonkeyPatch
) -> None:
    def refuse(*_arguments: object) -> bool:
        raise StorageError("the server answers 503")

    world.journal(*ROWS)
    monkeypatch.setattr(Storage, "exists", refuse)
    with pytest.raises(CannotResumeError, match="can't be read: the server answers 503"):
        world.taken()


@pytest.mark.parametrize(
    ("ran_with", "planned", "taken"), [(1, 1, True), (1, 1.0, True), (1, True, False)]
)
def test_a_value_of_another_type_is_another_case(
    world: World, ran_with: object, planned: Any, taken: bool
) -> None:
    """Python has 1 equal to true: what passed with one would stand for the other."""
    values = dataclasses.replace(case("a"), conditions=Conditions("", 0, {"flag": planned}))
    row = ran("a", scenario=0, values={"flag": ran_with})
    world.publish(row)
    world.earlier = EarlierResults(job="old", results=FOLDER, cases=1)
    if taken:
        assert [each["case"] for each in world.taken(Plan([values], []))] == ["a"]
    else:
        with pytest.raises(CannotResumeError, match="is not among this job's cases"):
            world.taken(Plan([values], []))
