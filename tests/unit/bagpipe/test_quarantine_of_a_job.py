"""A job's quarantine from its drivers to its results: one day, one answer, whoever goes on."""

from collections.abc import Callable
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import pytest

from bagpipe.driver import job as driver
from bagpipe.driver.job_day import job_day
from bagpipe.driver.keep import Keeper
from bagpipe.driver.progress import Progress
from bagpipe.driver.results import Results
from bagpipe.plan.case import Case
from bagpipe.plan.made import Plan
from bagpipe.report.stored import StoredResults
from bagpipe.spec import EarlierResults, JobFile
from bagpipe.storage import Storage, StorageError, StorageUnfitError
from tests.unit.bagpipe.drivers import case, ran
from tests.unit.bagpipe.jobs import make_job
from tests.unit.bagpipe.places import By, nothing

RULES = [{"cases": "b", "reason": "issue 17", "until": "2026-11-23"}]
BEFORE_MIDNIGHT = datetime(2026, 11, 23, 23, 59, 59, tzinfo=UTC).timestamp()
AFTER_MIDNIGHT = BEFORE_MIDNIGHT + 2

Run = Callable[[list[Case], Keeper], None]


class Two(By):
    """A job of two cases."""

    def planned(self, job: JobFile, storage: Storage) -> Plan:  # noqa: ARG002  the base class's signature
        return Plan([case("a"), case("b")], [])


def b_fails(cases: list[Case], keeper: Keeper) -> None:
    keeper.take([ran(c.id, "failed" if c.id == "b" else "passed", recorded=None) for c in cases])


def b_fails_and_the_pod_ends(cases: list[Case], keeper: Keeper) -> None:
    keeper.take([ran("b", "failed", recorded=None)])
    keeper.interrupt()
    assert len(cases) == 2


def drive(
    tmp_path: Path, run: Run, began: float = BEFORE_MIDNIGHT, uid: str = "uid-1", **changed: Any
) -> tuple[Progress, Path]:
    """What a driver that began then says at its end, and the job's folder."""
    resume = changed.pop("resume", None)
    spec = {"quarantine": RULES} | changed
    job = make_job({"results": str(tmp_path)}, **spec)
    job = job.model_copy(update={"uid": uid, "resume": resume})
    progress = Progress(Results(job, Storage(job.volumes)).folder, began=began)
    try:
        driver.ended(progress, lambda: driver.run(job, progress, Two(run)))
    except SystemExit:
        assert progress.reason == "Interrupted"
    return progress, tmp_path / "out/drive" / uid


def results(folder: Path) -> tuple[dict[str, Any], dict[str, Any]]:
    """A job's manifest, and its rows' marks by case."""
    stored = StoredResults(f"file://{folder}", Storage({}))
    return stored.manifest(), {row["case"]: row.get("quarantine") for row in stored.rows()}


def test_the_results_say_what_did_not_count_and_why(tmp_path: Path) -> None:
    progress, folder = drive(tmp_path, b_fails)
    assert (progress.phase, progress.verdict) == ("Complete", "Passed")
    manifest, marks = results(folder)
    assert marks == {"a": None, "b": RULES[0]}
    assert manifest["quarantine"] == {
        "day": "2026-11-23",
        "rules": [
            RULES[0]
            | {"holds": True, "inside": 1, "passed": 0, "failed": 1, "invalid": 0, "errored": 0}
        ],
    }
    assert [entry["quarantined"] for entry in manifest["cases"]] == [False, True]
    assert (manifest["counts"]["failed"], manifest["counts"]["quarantined"]) == (1, 1)
    assert manifest["message"].endswith("; 1 of 1 cases in quarantine did not pass")


def test_a_day_later_the_case_counts_again_and_the_message_says_so(tmp_path: Path) -> None:
    progress, folder = drive(tmp_path, b_fails, AFTER_MIDNIGHT)
    assert (progress.verdict, progress.snapshot()["cases"]["quarantined"]) == ("Failed", 0)
    assert progress.message == (
        "2 of 2 cases ran, verdict Failed; quarantine of 'b': ended with 2026-11-23: its 1 case"
        " counts again"
    )
    assert results(folder)[1] == {"a": None, "b": None}


def test_a_driver_that_goes_on_after_midnight_has_the_first_one_s_day(tmp_path: Path) -> None:
    drive(tmp_path, b_fails_and_the_pod_ends)
    progress, folder = drive(tmp_path, b_fails, AFTER_MIDNIGHT)
    assert progress.verdict == "Passed"
    assert results(folder)[0]["quarantine"]["day"] == "2026-11-23"


def test_of_two_drivers_one_says_the_day(tmp_path: Path) -> None:
    storage = Storage({"results": str(tmp_path)})
    days = [job_day(storage, "pvc://results/r", at) for at in (AFTER_MIDNIGHT, BEFORE_MIDNIGHT)]
    assert [day.isoformat() for day in days] == ["2026-11-24", "2026-11-24"]


@pytest.mark.parametrize("text", ["", "[]", '{"day": 3}', '{"day": "soon"}', "{}"])
def test_a_day_that_can_t_be_read_is_no_day(tmp_path: Path, text: str) -> None:
    (tmp_path / "r").mkdir()
    (tmp_path / "r/quarantine.json").write_text(text)
    with pytest.raises(StorageUnfitError, match=r"quarantine\.json does not say on which day"):
        job_day(Storage({"results": str(tmp_path)}), "pvc://results/r", AFTER_MIDNIGHT)


def test_a_job_that_takes_over_another_s_rows_looks_at_its_own_day(tmp_path: Path) -> None:
    def b_passes(cases: list[Case], keeper: Keeper) -> None:
        keeper.take([ran(c.id, "failed" if c.id == "a" else "passed") for c in cases])

    _, first = drive(tmp_path, b_passes, uid="first")
    assert results(first)[1]["b"] == RULES[0]
    uri = f"pvc://results/{first.relative_to(tmp_path)}"
    earlier = EarlierResults(job="first", results=uri, cases=2)

    def only_a(cases: list[Case], keeper: Keeper) -> None:
        assert [each.id for each in cases] == ["a"]
        keeper.take([ran("a")])

    progress, folder = drive(tmp_path, only_a, AFTER_MIDNIGHT, resume=earlier)
    assert progress.verdict == "Passed"
    assert results(folder)[1] == {"a": None, "b": None}


def test_what_failed_in_quarantine_runs_again_where_a_job_is_taken_over(tmp_path: Path) -> None:
    _, first = drive(tmp_path, b_fails, uid="first")
    uri = f"pvc://results/{first.relative_to(tmp_path)}"
    earlier = EarlierResults(job="first", results=uri, cases=2)
    ran_again: list[str] = []

    def again(cases: list[Case], keeper: Keeper) -> None:
        ran_again.extend(each.id for each in cases)
        b_fails(cases, keeper)

    drive(tmp_path, again, resume=earlier)
    assert ran_again == ["b"]


def test_a_quarantine_of_a_whole_quarter_and_a_day_runs_nothing(tmp_path: Path) -> None:
    rules = [RULES[0] | {"until": "2027-02-22"}]
    progress, folder = drive(tmp_path, nothing, quarantine=rules)
    assert (progress.phase, progress.reason) == ("Failed", "QuarantineInvalid")
    assert "at most 90 days, so write 2027-02-21 or an earlier day" in progress.message
    assert not (folder / "manifest.json").exists()


def test_a_job_without_quarantine_leaves_no_file_of_it(tmp_path: Path) -> None:
    _, folder = drive(tmp_path, b_fails, quarantine=[])
    assert not (folder / "quarantine.json").exists()
    assert results(folder)[0]["quarantine"] is None


def test_what_an_ended_job_did_is_not_changed_by_an_edit(tmp_path: Path) -> None:
    """A run on a laptop that was killed before it published, and goes on with another manifest."""
    job = make_job({"results": str(tmp_path)}, quarantine=RULES)
    found = Results(job, Storage(job.volumes))
    published: list[object] = []

    def killed(*_given: object) -> None:
        published.append(found)
        raise KeyboardInterrupt

    progress = Progress(found.folder, began=BEFORE_MIDNIGHT)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(Results, "publish", killed)
        with pytest.raises(KeyboardInterrupt):
            driver.run(job, progress, Two(b_fails))
    assert published
    progress, folder = drive(tmp_path, nothing, quarantine=[])
    assert progress.verdict == "Passed"
    assert results(folder)[1] == {"a": None, "b": RULES[0]}


def test_all_in_quarantine_is_no_pass(tmp_path: Path) -> None:
    rules = [{"cases": "?", "reason": "x", "until": "2026-11-30"}]
    progress, folder = drive(tmp_path, _all_pass, quarantine=rules)
    assert (progress.verdict, results(folder)[0]["verdictReason"]) == ("Invalid", "AllQuarantined")
    assert "no case counts: all are in quarantine" in progress.message


def _all_pass(cases: list[Case], keeper: Keeper) -> None:
    keeper.take([ran(each.id, recorded=None) for each in cases])


def test_no_more_than_a_day_s_worth_of_a_file_is_read(tmp_path: Path) -> None:
    (tmp_path / "r").mkdir()
    file, storage = tmp_path / "r/quarantine.json", Storage({"results": str(tmp_path)})
    file.write_text('{"day": "2026-11-23"}'.ljust(1 << 16))
    assert job_day(storage, "pvc://results/r", AFTER_MIDNIGHT).isoformat() == "2026-11-23"
    file.write_text('{"day": "2026-11-23"}'.ljust((1 << 16) + 1))
    with pytest.raises(StorageError, match=r"65,?536"):
        job_day(storage, "pvc://results/r", AFTER_MIDNIGHT)
