"""The comparison is a part of a job's verdict, and is made before the manifest is put."""

import json
from pathlib import Path
from typing import Any

import pytest

from bagpipe.driver.baseline import check_baseline
from bagpipe.driver.comparing import compared
from bagpipe.driver.own_pods import Seen
from bagpipe.driver.progress import Progress
from bagpipe.driver.provenance import provenance_of
from bagpipe.report.provenance import facts_of
from bagpipe.run.case_run import Row
from bagpipe.spec import FoundBaseline, SimulationJobSpec
from bagpipe.storage import Storage, StorageError
from tests.unit.bagpipe.jobs import make_job, make_row, make_spec
from tests.unit.report.publishing import publish, stored


def passed(*numbers: int) -> list[Row]:
    return [make_row(f"a-{n}", fragment=f"a-{n}") for n in numbers]


def against(tmp_path: Path, rows: list[Row], *allow: str, before: Any = None) -> dict[str, Any]:
    """The manifest of a job with these rows, after an earlier one of four that passed."""
    tmp_path.mkdir(exist_ok=True)
    first = publish(tmp_path, passed(0, 1, 2, 3) if before is None else before, uid="first")
    uri = f"pvc://results/{first.relative_to(tmp_path)}"
    folder = publish(tmp_path, rows, baseline={"results": uri}, comparison={"allow": list(allow)})
    found: dict[str, Any] = json.loads((folder / "manifest.json").read_text())
    return found


def verdict_of(manifest: dict[str, Any]) -> tuple[str, str]:
    return manifest["verdict"], manifest["verdictReason"]


def test_a_job_like_its_baseline_passes(tmp_path: Path) -> None:
    found = against(tmp_path, passed(0, 1, 2, 3))
    assert verdict_of(found) == ("Passed", "")
    assert [one["verdict"] for one in found["comparisons"]] == ["same"]


def test_a_job_whose_every_case_passed_and_that_lacks_one_has_regressed(tmp_path: Path) -> None:
    found = against(tmp_path, passed(0, 1, 2))
    assert (found["phase"], *verdict_of(found)) == ("Complete", "Failed", "Regressed")
    assert found["message"] == (
        "3 of 3 cases ran, verdict Failed; this job against the earlier job: 1 missing"
    )
    assert found["counts"]["regressed"] == 1
    assert verdict_of(against(tmp_path / "b", passed(0, 1, 2), "Missing")) == ("Passed", "")


def test_a_case_that_gives_no_evidence_any_more_is_worse_than_invalid(tmp_path: Path) -> None:
    rows = [*passed(0, 1, 2), make_row("a-3", "invalid", "NotEnoughEvidence", fragment="a-3")]
    assert verdict_of(against(tmp_path, rows)) == ("Failed", "Regressed")
    allowed = against(tmp_path / "b", rows, "Regressed")
    # What is allowed of the comparison makes no invalid case valid.
    assert verdict_of(allowed) == ("Invalid", "Invalid")


def test_a_case_that_failed_is_the_gravest(tmp_path: Path) -> None:
    rows = [make_row("a-0", "failed", "CriterionFailed", fragment="a-0")]
    found = against(tmp_path, rows)
    assert verdict_of(found) == ("Failed", "Failed")
    assert "1 regressed (1 failed)" in found["message"]
    assert verdict_of(against(tmp_path / "b", rows, "Regressed", "Missing")) == ("Failed", "Failed")


def measured(more: float) -> list[Row]:
    finding = {"name": "latency", "outcome": "passed", "unit": "s", "direction": "lower"}
    return [
        make_row(f"a-{n}", fragment=f"a-{n}", bag=f"b{n}",
                 criteria=[finding | {"figure": 1 + more * (n + 1)}])
        for n in range(6)
    ]  # fmt: skip


def test_worse_figures_fail_a_job_whose_every_case_passed(tmp_path: Path) -> None:
    found = against(tmp_path, measured(0.1), before=measured(0.0))
    assert verdict_of(found) == ("Failed", "WorseCriteria")
    assert found["message"].endswith("this job against the earlier job: worse in latency")
    allowed = against(tmp_path / "b", measured(0.1), "WorseCriteria", before=measured(0.0))
    assert verdict_of(allowed) == ("Passed", "")
    assert allowed["comparisons"][0]["verdict"] == "worse"  # still reported


def test_what_has_nothing_in_common_is_no_pass(tmp_path: Path) -> None:
    before = [make_row("b-0", "errored", "AgentDied", fragment="b-0")]
    found = against(tmp_path, passed(0), "Missing", before=before)
    assert verdict_of(found) == ("Invalid", "NothingCompared")
    allowed = against(tmp_path / "b", passed(0), "Missing", "Unknown", before=before)
    assert verdict_of(allowed) == ("Passed", "")


def with_baseline(uri: str) -> SimulationJobSpec:
    return make_spec(baseline={"results": uri})


def test_a_baseline_that_is_gone_at_the_end_is_no_pass(tmp_path: Path) -> None:
    storage = Storage({"results": str(tmp_path)})
    progress = Progress("r")
    progress.begin(1)
    progress.add(make_row("a-0"))
    progress.compare(compared(with_baseline("pvc://results/gone"), lambda: passed(0), storage))
    assert progress.finish()
    snapshot = progress.snapshot()
    assert (snapshot["phase"], snapshot["verdict"]) == ("Complete", "Invalid")
    assert snapshot["verdictReason"] == "BaselineUnreadable"
    assert "spec.baseline can't be read: pvc://results/gone/results.jsonl" in snapshot["message"]


def test_a_baseline_is_waited_for_as_other_storage_is() -> None:
    asked = []

    def patiently(make: Any) -> Any:
        asked.append(make)
        return []

    compared(with_baseline("pvc://results/gone"), list, Storage({}), patiently)
    assert len(asked) == 1


def test_a_baseline_without_a_case_is_refused_before_anything_runs(tmp_path: Path) -> None:
    stored(tmp_path, "", 0)
    with pytest.raises(StorageError, match=r"has no case: write status\.results of a job that ran"):
        check_baseline("pvc://results/", Storage({"results": str(tmp_path)}))


def test_a_damaged_baseline_is_refused_before_anything_runs(tmp_path: Path) -> None:
    stored(tmp_path, '{"case": "a", "outcome": "passed"}\n{\n', 2)
    with pytest.raises(StorageError, match=r"results\.jsonl line 2 is no row"):
        check_baseline("pvc://results/", Storage({"results": str(tmp_path)}))


def test_a_job_without_baseline_and_variants_compares_nothing() -> None:
    found = compared(make_job({}).spec, lambda: passed(0), Storage({}))
    assert (found.found, found.reason, found.objections) == ([], "", [])


def test_an_adopted_manifest_says_the_same(tmp_path: Path) -> None:
    manifest = against(tmp_path, passed(0, 1, 2))
    progress = Progress("r")
    progress.adopt(manifest)
    snapshot = progress.snapshot()
    assert (snapshot["verdict"], snapshot["verdictReason"]) == ("Failed", "Regressed")
    assert snapshot["comparisons"] == [
        {"variant": "", "verdict": "worse", "regressed": 1, "fixed": 0, "flaky": 0}
    ]


def test_a_first_night_is_judged_by_its_cases_alone_and_says_so(tmp_path: Path) -> None:
    job = make_job({"results": str(tmp_path)}, variants=[{"name": "a"}, {"name": "b"}])
    followed = FoundBaseline(schedule="nightly", message="nothing is compared: no job has passed")
    rows = [make_row("a-0", variant="a"), make_row("a-1", variant="b", outcome="failed")]
    storage = Storage(job.volumes)
    # Without it the second variant would be worse than the first.
    assert compared(job.spec, lambda: rows, storage).objections
    found = compared(job.spec, lambda: rows, storage, followed=followed)
    assert (found.found, found.reason, found.objections) == ([], "", [])
    progress = Progress("r")
    progress.begin(1)
    progress.add(make_row("a-0"))
    progress.compare(found)
    assert progress.finish()
    assert (progress.verdict, progress.verdict_reason) == ("Passed", "")
    assert progress.message == (
        "1 of 1 cases ran, verdict Passed; nothing is compared: no job has passed"
    )


def test_results_of_the_last_run_that_are_gone_are_refused_by_its_name(tmp_path: Path) -> None:
    followed = FoundBaseline(schedule="nightly", job="nightly-29914710")
    with pytest.raises(StorageError, match=r"nightly-29914710, the last job of the schedule night"):
        check_baseline("pvc://results/", Storage({"results": str(tmp_path)}), followed)


def test_the_results_say_what_they_were_compared_with(tmp_path: Path) -> None:
    job = make_job({"results": str(tmp_path)}, baseline={"results": "pvc://results/first"})
    assert provenance_of(job, [], Seen(), (0, 1))["baseline"] is None
    found = job.model_copy(update={"baseline": FoundBaseline(schedule="nightly", job="nightly-7")})
    written = provenance_of(found, [], Seen(), (0, 1))
    assert written["baseline"] == {
        "schedule": "nightly", "job": "nightly-7", "message": "", "results": "pvc://results/first"
    }  # fmt: skip
    facts = dict(facts_of({"provenance": written}))
    assert facts["baseline"] == "nightly-7, the last of the schedule nightly that passed"
    none = FoundBaseline(schedule="nightly", message="nothing is compared: it is the first night")
    written = provenance_of(job.model_copy(update={"baseline": none}), [], Seen(), (0, 1))
    assert dict(facts_of({"provenance": written}))["baseline"] == none.message


@pytest.mark.parametrize(
    ("baseline", "sentence"),
    [
        ({}, "baseline has results or lastPassed: write one of them"),
        (
            {"results": "pvc://r/x", "lastPassed": "schedule/a"},
            "baseline has results or lastPassed",
        ),
        ({"lastPassed": "nightly"}, "String should match pattern"),
        ({"lastPassed": "schedule/other/x"}, "String should match pattern"),
    ],
)
def test_a_baseline_is_one_job_s(baseline: dict[str, str], sentence: str) -> None:
    with pytest.raises(ValueError, match=sentence):
        make_spec(baseline=baseline)
