"""Two drivers of one job, in every order of their requests to storage, with answers that get lost
and a driver that dies anywhere: one manifest counts, and nothing that counts is ever removed.
"""

import json
from collections.abc import Mapping
from functools import partial
from types import SimpleNamespace
from typing import Any

import pytest

from bagpipe.driver import job as driver
from bagpipe.driver.keep import Keeper
from bagpipe.driver.progress import Progress
from bagpipe.plan.case import Case
from bagpipe.plan.made import Plan
from bagpipe.spec import JobFile
from bagpipe.storage import Storage, StorageError
from tests.unit.bagpipe import interleaving
from tests.unit.bagpipe.drivers import case, ran
from tests.unit.bagpipe.interleaving import Door, Programs, State, Step
from tests.unit.bagpipe.jobs import make_job

JOB = make_job({}, output={"uri": "s3://bucket/out"})
FOLDER = "s3://bucket/out/drive/uid-1"
MANIFEST, LINES = f"{FOLDER}/manifest.json", f"{FOLDER}/results.jsonl"
doors = SimpleNamespace()


class Place(driver.Place):
    """One case that records and one that does not; every driver's end in another way."""

    def __init__(self, door: Door) -> None:
        super().__init__()
        self._door = door

    def planned(self, job: JobFile, storage: Storage) -> Plan:  # noqa: ARG002  the base class's signature
        return Plan([case("a"), case("b")], [])

    def run_cases(self, job: JobFile, cases: list[Case], keeper: Keeper) -> None:  # noqa: ARG002
        number = self._door.program
        for each in cases:
            if each.id == "b":
                keeper.take([ran("b", ["failed", "invalid"][number % 2], recorded=None)])
                continue
            keeper.take([ran("a", recorded=self._recorded(number))])

    def _recorded(self, number: int) -> str:
        """Each try under a name of its own, as the workers do."""
        for attempt in range(2):
            name = f"cases/a-{number}-{attempt}.bag"
            try:
                with self._door.create(f"{FOLDER}/{name}") as file:
                    file.write(b"recorded")
            except StorageError:
                continue
            break
        return name


class NoArtefacts:
    """The forms beside results.jsonl can all be made again: they are left out."""

    def __init__(self, *_arguments: object) -> None:
        """Takes what the real ones take."""

    def __enter__(self) -> "NoArtefacts":
        return self

    def __exit__(self, *_error: object) -> None:
        """Holds nothing."""

    def add(self, _row: object) -> None:
        """Forgets it."""

    def store(self, *_arguments: object) -> list[Any]:
        return []


def counted(files: Mapping[str, bytes]) -> set[str]:
    manifest = json.loads(files[MANIFEST])
    return {f"{FOLDER}/{each['recorded']}" for each in manifest["cases"] if each["recorded"]}


def forbidden(files: Mapping[str, bytes], step: Step) -> None:
    """What no driver may ever ask for."""
    if step.uri == MANIFEST:
        assert step.name in {"put_once", "exists", "read"}, step
    if step.name != "remove":
        return
    assert MANIFEST in files, f"{step} before anything counts"
    assert step.uri not in counted(files), f"{step} counts"
    if "/journal/" in step.uri:
        assert LINES in files, f"{step} before its rows are published"


def name_of(door: Door) -> str:
    """The driver's, which no other has: one that comes later is none of the first."""
    return f"driver{door.program}of{door.programs}"


def drive(door: Door) -> Progress:
    """One driver from its begin to its end."""
    doors.mine, doors.name = door, name_of(door)
    progress = Progress(FOLDER)
    driver.run(JOB, progress, place=Place(door))
    return progress


def assert_whole(files: Mapping[str, bytes]) -> None:
    manifest = json.loads(files[MANIFEST])
    assert counted(files) <= files.keys()
    lines = [json.loads(line) for line in files[LINES].splitlines()]
    written = [(row["case"], row["outcome"], row["recorded"]) for row in lines]
    assert written == [(row["case"], row["outcome"], row["recorded"]) for row in manifest["cases"]]


def assert_ended(state: State) -> None:
    """Whoever has not crashed has ended well, and reported what counts."""
    for end in state.ends.values():
        assert end.error is None, (end.error, state.order)
        assert_whole(state.files)
        manifest = json.loads(state.files[MANIFEST])
        progress = end.result
        assert (progress.phase, progress.verdict) == (manifest["phase"], manifest["verdict"])


def follow(may_fail: bool = False, most: int | None = None) -> int:
    """Two drivers in their orders, behind each of which one comes alone; how many states."""
    one = Programs(1, drive)

    def ended(state: State) -> None:
        assert_ended(state)
        interleaving.orders(one, forbidden, partial(later, state), state.files)

    return interleaving.orders(Programs(2, drive), forbidden, ended, may_fail=may_fail, most=most)


def later(before: State, state: State) -> None:
    """The one that comes alone has left all as it is to be, and the manifest as it was."""
    assert_ended(state)
    assert_whole(state.files)
    assert not [uri for uri in state.files if "/journal/" in uri]
    if MANIFEST in before.files:
        assert state.files[MANIFEST] == before.files[MANIFEST]


@pytest.fixture(autouse=True)
def in_memory(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("bagpipe.driver.job.Storage", lambda _volumes: doors.mine)
    monkeypatch.setattr("bagpipe.driver.artefacts.Artefacts", NoArtefacts)
    unhurried = SimpleNamespace(Event=lambda: SimpleNamespace(wait=lambda _seconds: None))
    monkeypatch.setattr("bagpipe.driver.job.threading", unhurried)
    # Two runs may differ in their order alone: neither in random names nor in times.
    monkeypatch.setattr("bagpipe.driver.results.provenance_of", lambda *_: {}, raising=False)
    named = SimpleNamespace(uuid4=lambda: SimpleNamespace(hex=doors.name))
    monkeypatch.setattr("bagpipe.driver.journal.uuid", named)
    monkeypatch.setattr("bagpipe.driver.patience._PAUSE_SECONDS", 0.0)


# Promise: manifest-once
def test_of_two_drivers_in_every_order_one_counts_and_keeps_all_that_does() -> None:
    assert follow() > 100


def test_so_it_is_where_an_answer_is_lost_or_a_driver_dies() -> None:
    follow(may_fail=True, most=1000)
