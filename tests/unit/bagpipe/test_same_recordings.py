"""What a job's next driver makes of recordings that went, or came, since the first one planned."""

import gzip
import json
from dataclasses import replace
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

import pytest

from bagpipe.driver import job as driver
from bagpipe.driver import patience
from bagpipe.driver.chosen import chosen
from bagpipe.driver.first_plan import FILE, first_plan
from bagpipe.driver.journal import Journal
from bagpipe.driver.keep import Keeper
from bagpipe.driver.progress import Progress
from bagpipe.driver.results import Results
from bagpipe.driver.same_recordings import of_the_same_recordings
from bagpipe.plan.case import Case
from bagpipe.plan.fragments import Window
from bagpipe.plan.made import Plan, Unplanned
from bagpipe.run.case_run import Row
from bagpipe.source.planning import plan
from bagpipe.spec import JobFile
from bagpipe.storage import Storage, StorageError, StorageUnfitError
from tests.unit.bagpipe.bags import steady, write_bag
from tests.unit.bagpipe.jobs import make_job, make_row, make_spec
from tests.unit.bagpipe.places import By

RESULTS = "pvc://results/out/drive/uid-1"


def case(name: str, bag: str = "") -> Case:
    uri = f"pvc://recordings/{bag or name}.bag"
    return Case(name, uri, "9-1", Window(10, 20, 30), [], [(0, 9)], 1)


def ran(name: str, outcome: str, bag: str = "") -> Row:
    row = make_row(name, outcome, "" if outcome == "passed" else "CriterionFailed")
    here = {"window": [10, 20, 30], "bag_version": "9-1"}
    return row | here | {"bag": f"pvc://recordings/{bag or name}.bag"}


class Drivers(By):
    """The drivers of one job, one after the other: each plans what is there by then."""

    def __init__(self, tmp_path: Path) -> None:
        super().__init__(self.all_pass)
        self.volumes, self.tmp_path = {"results": str(tmp_path)}, tmp_path
        self.storage = Storage(self.volumes)
        self.plan, self.ran = Plan([], []), list[str]()
        self.attempt, self.interrupts = 0, False
        self.names: list[str] = []

    def planned(self, job: JobFile, storage: Storage) -> Plan:  # noqa: ARG002
        return self.plan

    def wanted(self, planned: Plan) -> Plan:
        return chosen(planned, self.names)

    def all_pass(self, cases: list[Case], keeper: Keeper) -> None:
        self.ran += [each.id for each in cases]
        if self.interrupts:
            keeper.interrupt()
            return
        keeper.take([ran(each.id, "passed", Path(each.bag).stem) for each in cases])

    def go(self, *cases: Case, unplanned: list[Unplanned] | None = None) -> Progress:
        self.plan, self.attempt = Plan(list(cases), unplanned or []), self.attempt + 1
        job = make_job(self.volumes).model_copy(update={"attempt": self.attempt})
        progress = Progress("r")
        try:
            driver.run(job, progress, self)
        except SystemExit:
            assert self.interrupts
        return progress

    def begin(self, *cases: Case, done: list[Row]) -> None:
        """A first driver that is ended when these rows are in the journal."""
        self.interrupts = True
        self.go(*cases)
        Journal(self.storage, RESULTS, 1).append(done)
        self.interrupts, self.ran = False, []

    def cases(self) -> dict[str, tuple[str, str]]:
        lines = (self.tmp_path / "out/drive/uid-1/results.jsonl").read_text().splitlines()
        rows = [json.loads(line) for line in lines]
        return {row["case"]: (row["outcome"], row.get("reason") or "") for row in rows}


def again(storage: Storage, planned: Plan, journaled: Any = list) -> tuple[list[str], list[str]]:
    """What a driver of the job makes of its plan: its cases, and the URIs of what is errored."""
    found = of_the_same_recordings(storage, RESULTS, planned, journaled)
    return [each.id for each in found.cases], [each.bag for each in found.unplanned]


def test_a_case_that_failed_counts_though_its_recording_is_gone(tmp_path: Path) -> None:
    drivers = Drivers(tmp_path)
    began = [case("tuesday"), case("monday"), case("sunday")]
    drivers.begin(*began, done=[ran("tuesday", "passed"), ran("monday", "failed")])
    progress = drivers.go(case("tuesday"))
    assert (progress.phase, progress.verdict, progress.reason) == ("Failed", "", "BagMissing")
    errored = {name: of for name, of in drivers.cases().items() if of[0] != "passed"}
    assert [name.rpartition("-")[0] for name in errored] == ["monday", "sunday"]
    assert set(errored.values()) == {("errored", "BagMissing")}


def test_so_it_does_where_an_earlier_release_began_the_job(tmp_path: Path) -> None:
    drivers = Drivers(tmp_path)
    Journal(drivers.storage, RESULTS, 1).append([ran("tuesday", "passed"), ran("monday", "failed")])
    progress = drivers.go(case("tuesday"))
    assert (progress.phase, progress.reason) == ("Failed", "BagMissing")


def test_recordings_that_came_later_are_another_job_s(tmp_path: Path) -> None:
    drivers = Drivers(tmp_path)
    drivers.begin(case("monday"), case("tuesday"), done=[ran("monday", "passed")])
    late = Unplanned("broken", "pvc://recordings/broken.bag", "BagUnreadable", "no bag")
    progress = drivers.go(case("monday"), case("tuesday"), case("wednesday"), unplanned=[late])
    assert (progress.verdict, drivers.ran, progress.planned) == ("Passed", ["tuesday"], 2)


def test_a_case_keeps_the_name_that_it_had_first_and_gets_no_second_chance(tmp_path: Path) -> None:
    """A second recording of its name came, so that both have digits of their URIs."""
    drivers = Drivers(tmp_path)
    drivers.begin(case("monday-0000", "a/monday"), done=[ran("monday-0000", "failed", "a/monday")])
    again = case("monday-aaaa-0000", "a/monday"), case("monday-bbbb-0000", "b/monday")
    progress = drivers.go(*again)
    assert (progress.verdict, drivers.ran) == ("Failed", [])
    assert drivers.cases() == {"monday-0000": ("failed", "CriterionFailed")}


@pytest.mark.parametrize(
    ("first", "now", "named"),
    [
        ("monday-0000", "monday-aaaa-0000", {"0000": "monday-0000", "0012-s1": "monday-0012-s1"}),
        ("monday-aaaa-0000", "monday-0000", {"0000": "monday-aaaa-0000"}),
        ("data-0000", "data-000a-0000", {"0001": "data-0001"}),
        ("monday-0001", "monday-aaaa-0000", {"0000": "monday-0000", "0001": "monday-0001"}),
    ],
)
def test_all_fragments_of_a_recording_keep_their_names(
    tmp_path: Path, first: str, now: str, named: dict[str, str]
) -> None:
    storage = Storage({"results": str(tmp_path)})
    of_the_same_recordings(storage, RESULTS, Plan([case(first, "m")], []), list)
    stem = now.rpartition("-")[0]
    by_now = [case(f"{stem}-{number}", "m") for number in named]
    assert again(storage, Plan(by_now, [])) == (list(named.values()), [])


def test_files_keep_their_names_too(tmp_path: Path) -> None:
    """A second file of its name has come, so that both have their endings."""
    storage = Storage({"results": str(tmp_path)})
    of_the_same_recordings(storage, RESULTS, Plan([case("drive-0001", "x")], []), list)
    now = case("drive-0001.bin", "x"), case("drive-0001.txt", "y")
    assert again(storage, Plan(list(now), [])) == (["drive-0001"], [])


def test_a_recording_that_was_replaced_is_run_again(tmp_path: Path) -> None:
    drivers = Drivers(tmp_path)
    old = ran("monday", "failed") | {"bag_version": "8-0"}
    drivers.begin(case("monday"), done=[old])
    assert (drivers.go(case("monday")).verdict, drivers.ran) == ("Passed", ["monday"])


def test_a_part_that_is_gone_takes_the_cases_that_were_put_together_of_it(tmp_path: Path) -> None:
    storage = Storage({"results": str(tmp_path)})
    part = {"bag": "pvc://recordings/b.bag"}

    def journaled() -> list[dict[str, Any]]:
        return [{"case": "ab", "bag": "a word", "parts": [part]}]

    assert again(storage, Plan([case("a")], []), journaled) == (["a"], [part["bag"]])


class Hurried(Storage):
    """That of a driver which looked when the other had kept nothing yet."""

    def exists(self, uri: str) -> bool:  # noqa: ARG002  as the base class's
        return False


def test_the_first_of_two_drivers_that_begin_at_once_counts(tmp_path: Path) -> None:
    for kind, planned in ((Storage, [case("a")]), (Hurried, [case("a"), case("b")])):
        assert again(kind({"results": str(tmp_path)}), Plan(planned, [])) == (["a"], [])


def test_a_name_is_that_of_the_first_fragment_in_whichever_order_they_run(tmp_path: Path) -> None:
    storage = Storage({"results": str(tmp_path)})
    planned = Plan([case("m-0002", "m"), case("m-0001", "m")], [])
    first = first_plan(storage, RESULTS, planned, lambda planned: planned, list)
    assert first.recordings == {"pvc://recordings/m.bag": "m-0001"}


def test_no_piece_is_called_as_what_it_is_a_piece_of(tmp_path: Path) -> None:
    storage = Storage({"results": str(tmp_path)})
    parts = [{"bag": "pvc://recordings/m.bag"}]

    def journaled() -> list[Row]:
        return [{"case": "sequence-0000", "bag": "sequence", "window": [], "parts": parts}]

    made = of_the_same_recordings(storage, RESULTS, Plan([case("m-0000", "m")], []), journaled)
    assert [each.id for each in made.cases] == ["m-0000"]


def test_storage_that_is_away_for_a_while_is_waited_for(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    pauses: list[float] = []

    def patiently(action: Any, progress: Progress) -> Any:
        return patience.patiently(action, progress, pause=pauses.append)

    def put_once(storage: Storage, uri: str, data: bytes) -> bool:
        if uri.endswith(FILE) and not pauses:
            raise StorageError("503")
        return put(storage, uri, data)

    put = Storage.put_once
    monkeypatch.setattr(Storage, "put_once", put_once)
    monkeypatch.setattr(driver, "patiently", patiently)
    assert (Drivers(tmp_path).go(case("a")).verdict, len(pauses)) == ("Passed", 1)


@pytest.mark.parametrize(
    "content",
    [b"", b"no gzip", gzip.compress(b"{"), gzip.compress(b'{"recordings": 7}')],
    ids=["empty", "no gzip", "no JSON", "no list"],
)
def test_what_can_t_be_read_ends_the_driver(tmp_path: Path, content: bytes) -> None:
    file = tmp_path / "out/drive/uid-1" / FILE
    file.parent.mkdir(parents=True)
    file.write_bytes(content)
    with pytest.raises(StorageUnfitError, match="does not say with which recordings the job began"):
        of_the_same_recordings(
            Storage({"results": str(tmp_path)}), RESULTS, Plan([case("a")], []), list
        )


SECOND = 1_000_000_000


def sequence_spec() -> Any:
    pieces = [{"bag": f"pvc://recordings/{name}.bag"} for name in "ab"]
    return make_spec(source={"sequence": pieces})


def bag(folder: Path, name: str) -> None:
    write_bag(folder / f"{name}.bag", steady("/scan", 20, SECOND // 10), chunk_bytes=500)


def test_a_sequence_whose_piece_came_later_is_not_left_out_in_silence(tmp_path: Path) -> None:
    """It was errored for want of b.bag, which is there by now: it runs, or is errored still."""
    (tmp_path / "r").mkdir()
    storage = Storage({"results": str(tmp_path), "recordings": str(tmp_path / "r")})
    bag(tmp_path / "r", "a")
    assert again(storage, plan(sequence_spec(), storage)) == ([], ["pvc://recordings/b.bag"])
    bag(tmp_path / "r", "b")
    made = plan(sequence_spec(), storage)
    assert len(made.cases) == 1
    assert again(storage, made) == ([], [made.cases[0].bag])


def test_and_the_job_is_not_passed_without_it(tmp_path: Path) -> None:
    """Two conditions: c1 plays x, c2 plays a and b, and b was not there yet."""
    drivers = Drivers(tmp_path)
    late = Unplanned("sequence-c2", "pvc://recordings/b.bag", "BagUnreadable", "b.bag: not there")
    drivers.plan = Plan([case("x")], [late])
    drivers.interrupts = True
    drivers.go(case("x"), unplanned=[late])
    drivers.interrupts, drivers.ran = False, []

    class Part:
        def __init__(self, uri: str) -> None:
            self.bag, self.bytes = uri, 9

        def as_row(self) -> dict[str, Any]:
            return {"bag": self.bag}

    parts: Any = [Part(f"pvc://recordings/{name}.bag") for name in "ab"]
    together = Case("sequence-c2", "sequence", "v", Window(10, 20, 30), [], [], 1, parts=parts)
    progress = drivers.go(case("x"), together)
    assert (progress.verdict, drivers.ran) != ("Passed", ["x"])


def test_a_piece_that_is_there_is_not_called_gone(tmp_path: Path) -> None:
    (tmp_path / "r").mkdir()
    storage = Storage({"results": str(tmp_path), "recordings": str(tmp_path / "r")})
    bag(tmp_path / "r", "a")
    bag(tmp_path / "r", "b")
    assert len(again(storage, plan(sequence_spec(), storage))[0]) == 1
    (tmp_path / "r" / "b.bag").unlink()
    made = of_the_same_recordings(storage, RESULTS, plan(sequence_spec(), storage), list)
    [of_a] = [each for each in made.unplanned if each.bag == "pvc://recordings/a.bag"]
    assert "is in no case of what another driver of it found" in of_a.message


def test_a_folder_that_could_not_be_listed_is_not_called_empty(tmp_path: Path) -> None:
    """What `expanded` makes of a listing that storage refused for a minute."""
    storage = Storage({"results": str(tmp_path)})
    again(storage, Plan([case("a"), case("b")], []))
    why = "pvc://recordings/*.bag can't be read: 503 Slow Down"
    failed = Unplanned("bag", "pvc://recordings/*.bag", "BagMissing", why)
    lost = of_the_same_recordings(storage, RESULTS, Plan([], [failed]), list).unplanned
    assert why in [each.message for each in lost]
    assert len(lost) == 3


class Quarantined(Drivers):
    def go(self, *cases: Case, unplanned: list[Unplanned] | None = None) -> Progress:
        self.plan, self.attempt = Plan(list(cases), unplanned or []), self.attempt + 1
        until = (datetime.now(UTC).date() + timedelta(days=30)).isoformat()
        rule = {"cases": "monday-0000", "reason": "issue 412", "until": until}
        job: JobFile = make_job(self.volumes, quarantine=[rule])
        progress = Progress("r")
        try:
            driver.run(job.model_copy(update={"attempt": self.attempt}), progress, self)
        except SystemExit:
            assert self.interrupts
        return progress


def test_a_case_keeps_its_name_and_so_its_quarantine_when_another_drive_is_uploaded(
    tmp_path: Path,
) -> None:
    """*/monday.bag: b/monday.bag comes while the job's first driver is evicted."""
    drivers = Quarantined(tmp_path)
    began = case("monday-0000", "a/monday"), case("tuesday")
    drivers.begin(*began, done=[ran("monday-0000", "failed", "a/monday"), ran("tuesday", "passed")])
    came = case("monday-bbbb-0000", "b/monday")
    progress = drivers.go(case("monday-aaaa-0000", "a/monday"), came, case("tuesday"))
    assert (progress.verdict, drivers.ran) == ("Passed", []), progress.message


def test_a_driver_that_dies_behind_its_manifest_leaves_results_that_another_can_publish(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    drivers = Drivers(tmp_path)
    began = case("monday-0000", "a/monday"), case("tuesday")
    drivers.begin(*began, done=[ran("monday-0000", "passed", "a/monday")])
    again = case("monday-aaaa-0000", "a/monday"), case("tuesday")

    def dies(*_args: object) -> None:
        raise KeyboardInterrupt

    with monkeypatch.context() as patch:
        patch.setattr(Results, "publish", dies)
        with pytest.raises(KeyboardInterrupt):
            drivers.go(*again)
    monkeypatch.setattr(patience, "PATIENCE_SECONDS", 0.0)
    progress = drivers.go(*again)  # StorageError: there is no row of case monday-aaaa-0000
    assert (progress.phase, progress.verdict) == ("Complete", "Passed")


def folder(name: str, uri: str, *files: str) -> Case:
    """A case of a folder of rosbag2, which has files of its own."""

    class Part:
        bytes = 9

        def __init__(self, uri: str) -> None:
            self.bag = uri

        def as_row(self) -> dict[str, Any]:
            return {"bag": self.bag}

    parts: Any = [Part(f"{uri}/{each}") for each in files]
    return Case(name, f"{uri}/metadata.yaml", "v", Window(10, 20, 30), [], [], 1, parts=parts)


def test_the_cases_of_a_folder_keep_their_names_too_and_so_their_failures(tmp_path: Path) -> None:
    drivers = Drivers(tmp_path)
    mine = folder("monday-0000", "pvc://r/a/monday", "m_0.mcap")
    row = make_row("monday-0000", "failed", "CriterionFailed", window=[10, 20, 30], bag_version="v")
    drivers.begin(mine, done=[row | {"bag": mine.bag} | mine.pieces])
    came = folder("monday-bbbb-0000", "pvc://r/b/monday", "m_0.mcap")
    by_now = folder("monday-aaaa-0000", "pvc://r/a/monday", "m_0.mcap")
    progress = drivers.go(by_now, came)
    assert (progress.verdict, drivers.ran) == ("Failed", [])
    assert list(drivers.cases()) == ["monday-0000"]


def test_a_folder_that_was_unreadable_at_first_is_run_or_errored(tmp_path: Path) -> None:
    storage = Storage({"results": str(tmp_path)})
    broken = [
        Unplanned("monday", "pvc://r/a/monday/metadata.yaml", "BagUnreadable", "503"),
        Unplanned("broken", "pvc://r/broken.bag", "BagUnreadable", "no bag"),
    ]
    again(storage, Plan([], broken))
    by_now = Plan([folder("monday-0000", "pvc://r/a/monday", "m_0.mcap")], broken[1:])
    assert again(storage, by_now) == (["monday-0000"], ["pvc://r/broken.bag"])


def test_what_is_lost_is_errored_whichever_cases_are_wanted(tmp_path: Path) -> None:
    """`bagpipe run --cases '*-0000'`, a failed case, Ctrl-C; its recording goes; `--resume`."""
    drivers = Drivers(tmp_path)
    drivers.names = ["*-0000"]
    began = case("night-0001-0000", "night-0001"), case("day-0001-0000", "day-0001")
    drivers.begin(*began, done=[ran("night-0001-0000", "failed", "night-0001")])
    progress = drivers.go(began[1])
    assert (progress.phase, progress.reason) == ("Failed", "BagMissing")


def test_rows_of_bags_without_cases_give_no_names(tmp_path: Path) -> None:
    """An earlier release could not read them; another driver can, and they are two."""
    storage = Storage({"results": str(tmp_path)})
    names = ("drive-0001", "drive-0002")
    uris = [f"pvc://recordings/{name}.bag" for name in names]

    def journaled() -> list[dict[str, Any]]:
        return [{"case": name, "bag": uri} for name, uri in zip(names, uris, strict=True)]

    by_now = Plan([case(f"{name}-0000", name) for name in names], [])
    assert again(storage, by_now, journaled) == (["drive-0001-0000", "drive-0002-0000"], [])
    with_marks = Plan([case(f"{name}-aaaa-0000", name) for name in names], [])
    assert again(storage, with_marks) == (["drive-0001-0000", "drive-0002-0000"], [])


def test_two_cases_never_get_one_name(tmp_path: Path) -> None:
    storage = Storage({"results": str(tmp_path)})
    of_the_same_recordings(
        storage, RESULTS, Plan([case("m-0000", "a"), case("m-0001", "b")], []), list
    )
    by_now = Plan([case("x-0000", "a"), case("y-0000", "b")], [])
    with pytest.raises(StorageUnfitError, match="two cases would have the name m-0000"):
        again(storage, by_now)


def test_three_cases_of_a_folder_that_grows_are_the_same_three_when_they_are_gone_on_with(
    tmp_path: Path,
) -> None:
    """`bagpipe run --cases 3`, Ctrl-C, a recording comes whose name is the first, `--resume`."""
    drivers = Drivers(tmp_path)
    drivers.names = ["3"]
    began = [case(name) for name in "bcde"]
    drivers.begin(*began, done=[ran("b", "passed"), ran("d", "passed")])
    progress = drivers.go(case("a"), *began)
    assert (progress.verdict, drivers.ran) == ("Passed", ["c"]), progress.message


def unread(name: str) -> Unplanned:
    return Unplanned(name, f"pvc://recordings/{name}.bag", "BagUnreadable", "no index yet")


def test_a_recording_that_grew_takes_no_failed_case_out_of_the_number(tmp_path: Path) -> None:
    """`bagpipe run --cases 3`, a failed case, Ctrl-C, a.bag is written further, `--resume`."""
    drivers = Drivers(tmp_path)
    drivers.names = ["3"]
    began = [case(f"{name}-0000", name) for name in "abc"]
    done = [ran("b-0000", "passed", "b"), ran("c-0000", "failed", "c")]
    drivers.begin(*began, case("d-0000", "d"), done=done)
    progress = drivers.go(*began, case("a-0001", "a"), case("a-0002", "a"))
    assert (progress.verdict, drivers.ran) == ("Failed", ["a-0000"])
    assert sorted(drivers.cases()) == ["a-0000", "b-0000", "c-0000"]


def test_nor_does_one_that_can_be_read_by_now_whichever_others_can(tmp_path: Path) -> None:
    """Of each that could not be read as many cases are run as are wanted of all."""
    drivers = Drivers(tmp_path)
    drivers.names = ["2"]
    drivers.interrupts = True
    drivers.go(*(case(name) for name in "cde"), unplanned=[unread("a"), unread("b")])
    Journal(drivers.storage, RESULTS, 1).append([ran("d", "failed")])
    of_b = [case(f"b-{n:04d}", "b") for n in range(3)]
    drivers.go(*(case(name) for name in "cde"), *of_b, unplanned=[unread("a")])
    Journal(drivers.storage, RESULTS, 2).append([ran("b-0001", "failed", "b")])
    drivers.interrupts, drivers.ran = False, []
    progress = drivers.go(*(case(name) for name in "acde"), *of_b)
    assert (progress.verdict, sorted(drivers.ran)) == ("Failed", ["a", "b-0000", "c"])
    assert sorted(drivers.cases()) == ["a", "b-0000", "b-0001", "c", "d"]


def test_of_what_can_be_read_by_now_the_wanted_names_are_run(tmp_path: Path) -> None:
    drivers = Drivers(tmp_path)
    drivers.names = ["night*"]
    drivers.interrupts = True
    broken = [unread("night"), unread("nights"), unread("day")]
    drivers.go(case("night-0"), case("day-0"), unplanned=broken)
    drivers.interrupts, drivers.ran = False, []
    by_now = [case("night-1", "night"), case("other", "nights"), case("day-1", "day")]
    assert drivers.go(case("night-0"), case("day-0"), *by_now).verdict == "Passed"
    assert sorted(drivers.ran) == ["night-0", "night-1"]


def test_a_recording_that_nobody_wanted_may_go(tmp_path: Path) -> None:
    """`bagpipe run --cases 'night-*'`, Ctrl-C, day.bag is removed, `--resume`."""
    drivers = Drivers(tmp_path)
    drivers.names = ["night-*"]
    began = [case("night-0000", "night"), case("day-0000", "day")]
    drivers.begin(*began, done=[])
    progress = drivers.go(began[0])
    assert (progress.verdict, drivers.ran) == ("Passed", ["night-0000"])


def test_a_chosen_case_that_a_shorter_recording_has_no_more_is_errored(tmp_path: Path) -> None:
    drivers = Drivers(tmp_path)
    drivers.names = ["*-0001"]
    began = [case("a-0000", "a"), case("a-0001", "a"), case("b-0001", "b")]
    drivers.begin(*began, done=[ran("a-0001", "failed", "a")])
    progress = drivers.go(began[0], began[2])
    assert (progress.phase, progress.verdict, progress.reason) == ("Failed", "", "BagMissing")
    assert drivers.cases()["a-0001"] == ("errored", "BagMissing")


def test_a_driver_goes_on_with_the_recordings_that_an_earlier_release_has_kept(
    tmp_path: Path,
) -> None:
    """Which has kept neither the choice nor the names of what yields no case."""
    drivers = Drivers(tmp_path)
    drivers.names = ["*-0000"]
    names = {f"pvc://recordings/{bag}.bag": f"{bag}-0000" for bag in "ab"}
    document = {"schema": "sim.bagpipe.io/recordings/v1alpha1", "recordings": names}
    (tmp_path / "out/drive/uid-1").mkdir(parents=True)
    kept = tmp_path / "out/drive/uid-1" / FILE
    kept.write_bytes(gzip.compress(json.dumps(document).encode()))
    progress = drivers.go(*(case(f"{bag}-0000", bag) for bag in "abc"), case("b-0001", "b"))
    assert (progress.verdict, drivers.ran) == ("Passed", ["a-0000", "b-0000"])


def test_what_yields_no_case_keeps_its_name_too_and_so_its_quarantine(tmp_path: Path) -> None:
    """*/monday.bag: b/monday.bag comes while the job's first driver is evicted."""
    drivers = Quarantined(tmp_path)
    drivers.interrupts = True
    uri = "pvc://recordings/a/monday.bag"
    broken = Unplanned("monday-0000", uri, "BagUnreadable", "cut off")
    drivers.go(case("x"), unplanned=[broken])
    drivers.interrupts = False
    by_now = Unplanned("monday-0000-aaaa", uri, "BagUnreadable", "cut off")
    progress = drivers.go(case("x"), case("monday-0000-bbbb", "b/monday"), unplanned=[by_now])
    assert (progress.verdict, sorted(drivers.cases())) == ("Passed", ["monday-0000", "x"])


@pytest.mark.parametrize(("then", "now"), [(2, 2), (2, 1), (1, 2)])
def test_what_yields_no_case_for_several_reasons_keeps_them_apart(
    tmp_path: Path, then: int, now: int
) -> None:
    storage = Storage({"results": str(tmp_path)})
    reasons = [replace(unread("a"), id=name) for name in ("a-c1", "a-c2")]
    again(storage, Plan([case("x")], reasons[:then]))
    by_now = Plan([case("x"), case("y")], reasons[:now])
    made = of_the_same_recordings(storage, RESULTS, by_now, list)
    assert made.unplanned == by_now.unplanned


def sequence(name: str, *bags: str) -> Case:
    whole = folder(name, "pvc://recordings", *(f"{bag}.bag" for bag in bags))
    return replace(whole, bag="sequence")


def test_a_case_of_others_that_nobody_chose_is_not_errored(tmp_path: Path) -> None:
    """Sequences share pieces, one of them is chosen, and one could not be read."""
    drivers = Drivers(tmp_path)
    drivers.names = ["one"]
    began = [sequence("one", "a", "b"), sequence("two", "b", "c")]
    drivers.interrupts = True
    drivers.go(*began, unplanned=[replace(unread("d"), id="three")])
    drivers.interrupts, drivers.ran = False, []
    assert drivers.go(*began, sequence("three", "a", "d")).verdict == "Passed"
    assert drivers.ran == ["one"]


def test_one_that_was_chosen_and_could_not_be_read_is_not_left_out(tmp_path: Path) -> None:
    drivers = Drivers(tmp_path)
    drivers.names = ["x", "three"]
    drivers.interrupts = True
    drivers.go(case("x"), unplanned=[replace(unread("d"), id="three")])
    drivers.interrupts = False
    progress = drivers.go(case("x"), sequence("three", "a", "d"))
    assert (progress.phase, progress.reason) == ("Failed", "BagMissing")


def test_a_recording_that_only_some_conditions_refuse_adds_no_case_to_the_number(
    tmp_path: Path,
) -> None:
    drivers = Drivers(tmp_path)
    drivers.names = ["1"]
    refused = Unplanned("m-c2", "pvc://recordings/m.bag", "BagUnreadable", "no such topic")
    drivers.go(case("m-c1", "m"), case("m-c3", "m"), unplanned=[refused])
    assert drivers.ran == ["m-c1"]


def test_a_failed_case_counts_where_the_release_that_began_the_job_kept_nothing(
    tmp_path: Path,
) -> None:
    drivers = Drivers(tmp_path)
    drivers.names = ["1"]
    Journal(drivers.storage, RESULTS, 1).append([ran("d", "failed")])
    assert drivers.go(case("a"), case("d")).verdict == "Failed"


def test_what_is_lost_is_named_once(tmp_path: Path) -> None:
    """Of a recording that is gone with two chosen cases, and of a case that is of others by now."""
    storage = Storage({"results": str(tmp_path)})
    of_a = [case("a-0000", "a"), case("a-0001", "a")]
    one = sequence("one", "b", "c")

    def wanted(planned: Plan) -> Plan:
        return chosen(planned, ["a-*", "one"])

    def driver_over(*cases: Case) -> list[Unplanned]:
        planned = Plan(list(cases), [])
        return of_the_same_recordings(storage, RESULTS, planned, list, wanted).unplanned

    assert driver_over(case("x"), *of_a, one) == []
    lost = [each.bag for each in driver_over(case("x"), sequence("one", "b", "d"), case("c"))]
    assert lost == ["pvc://recordings/a.bag", "sequence"]


def test_what_no_waiting_mends_is_not_waited_for(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    file = tmp_path / "out/drive/uid-1" / FILE
    file.parent.mkdir(parents=True)
    file.write_bytes(b"no gzip")
    monkeypatch.setattr(patience.log, "warning", None)  # what it calls before it waits
    with pytest.raises(StorageUnfitError, match="create the job again"):
        Drivers(tmp_path).go(case("a"))


@pytest.mark.parametrize("outcome", ["failed", "passed"])
def test_a_recording_that_is_shorter_by_now_takes_no_case_along(
    tmp_path: Path, outcome: str
) -> None:
    """Where nobody chose cases, too: what failed in it would be forgotten."""
    drivers = Drivers(tmp_path)
    first, second = case("a-0000", "a"), case("a-0001", "a")
    drivers.begin(first, second, case("b-0000", "b"), done=[ran("a-0001", outcome, "a")])
    drivers.go(first, case("b-0000", "b"))
    assert drivers.cases() == {
        "a-0000": ("passed", ""),
        "a-0001": ("errored", "BagMissing"),
        "b-0000": ("passed", ""),
    }
