"""What a job publishes beside its lines: JUnit XML, the table, and comparisons."""

import json
from pathlib import Path
from typing import Any

import pyarrow.parquet as pq
import pytest
from click.testing import CliRunner

from bagpipe.cli.__main__ import main
from bagpipe.cli.manifest import read_job
from bagpipe.compare.compare import Comparison
from bagpipe.driver.baseline import baseline_rows, check_baseline
from bagpipe.driver.comparing import in_short
from bagpipe.evaluate.finding import Finding
from bagpipe.plan.case import Case
from bagpipe.plan.fragments import Window
from bagpipe.report.html import Report
from bagpipe.report.table import SCHEMA
from bagpipe.run.case_run import lost_row
from bagpipe.storage import Storage, StorageError
from tests.unit.bagpipe.jobs import make_job, make_row
from tests.unit.report.publishing import publish, stored, versions


def short_comparisons(folder: Path) -> list[dict[str, Any]]:
    stored = json.loads((folder / "comparison.json").read_text())
    return [in_short(comparison) for comparison in stored["comparisons"]]


def test_every_form_holds_every_case(tmp_path: Path) -> None:
    folder = publish(tmp_path, [make_row("a-0000"), make_row("a-0001", "failed", "Bad")])
    lines = [json.loads(line) for line in (folder / "results.jsonl").read_text().splitlines()]
    assert [(x["schema"], x["case"]) for x in lines] == [
        ("sim.bagpipe.io/case/v1alpha1", "a-0000"),
        ("sim.bagpipe.io/case/v1alpha1", "a-0001"),
    ]
    assert pq.read_table(folder / "results.parquet")["case"].to_pylist() == ["a-0000", "a-0001"]
    assert (folder / "junit.xml").read_text().count("<testcase ") == 2
    assert not (folder / "comparison.json").exists()


def test_results_writes_the_very_junit_file_that_the_driver_wrote(tmp_path: Path) -> None:
    rows = [
        make_row("a-0000", variant="pr-812", seconds=2.5, discarded=["AgentDied"], attempts=2),
        make_row("a-0001", "failed", "StackCrashed", variant="pr-812", stderr=["boom"]),
        make_row("a-0002", variant="released"),
    ]
    folder = publish(tmp_path, rows)
    again = tmp_path / "again.xml"
    ended = CliRunner().invoke(main, ["results", str(folder), "--junit", str(again)])
    assert ended.exit_code == 1, ended.output
    assert again.read_bytes() == (folder / "junit.xml").read_bytes()
    assert b'time="2.500"' in again.read_bytes()
    assert b"stderr: boom" in again.read_bytes()


def test_variants_are_compared(tmp_path: Path) -> None:
    folder = publish(
        tmp_path, versions(failing={3}), variants=[{"name": "released"}, {"name": "pr-812"}]
    )
    stored = json.loads((folder / "comparison.json").read_text())
    [comparison] = stored["comparisons"]
    assert (comparison["variant"], comparison["verdict"]) == ("pr-812", "worse")
    assert [case["case"] for case in comparison["regressed"]] == ["a-0003-pr-812"]
    assert short_comparisons(folder) == [
        {"variant": "pr-812", "verdict": "worse", "regressed": 1, "fixed": 0, "flaky": 0}
    ]


def test_an_earlier_job_is_the_baseline(tmp_path: Path) -> None:
    first = publish(tmp_path, [make_row(f"a-{n}", fragment=f"a-{n}") for n in range(3)])
    uri = f"pvc://results/{first.relative_to(tmp_path)}"
    now = [
        make_row(f"a-{n}", "failed" if n == 1 else "passed", fragment=f"a-{n}") for n in range(3)
    ]
    second = publish(tmp_path, now, uid="uid-2", baseline={"results": uri})
    [comparison] = json.loads((second / "comparison.json").read_text())["comparisons"]
    assert (comparison["baseline"], comparison["verdict"]) == ("the earlier job", "worse")
    assert comparison["regressed"] == [{"case": "a-1", "to": "failed", "reason": ""}]


def baselines_in(page: Path) -> dict[str, str]:
    """The baseline's case of each case in a report."""
    data = page.read_text().split('id="data">', 1)[1].split("</script>", 1)[0]
    return {name: each["case"] for name, each in json.loads(data)["baselines"].items()}


def test_the_earlier_job_s_courses_are_in_the_report(tmp_path: Path) -> None:
    course = {"label": "l", "unit": "", "low": 1, "high": None, "points": [[0, 2.0], [1, 3.0]]}
    found = {"name": "c", "kind": "bounds", "outcome": "passed", "course": course}
    rows = [make_row(f"a-{n}", fragment=f"a-{n}", criteria=[found]) for n in range(3)]
    first = publish(tmp_path, rows)
    uri = f"pvc://results/{first.relative_to(tmp_path)}"
    second = publish(tmp_path, rows[1:], uid="uid-2", baseline={"results": uri})
    assert baselines_in(second / "report.html") == {"a-1": "a-1", "a-2": "a-2"}
    again = tmp_path / "again.html"
    arguments = ["report", str(second), "-o", str(again), "--volume", f"results={tmp_path}"]
    ended = CliRunner().invoke(main, arguments)
    assert (ended.exit_code, ended.stderr) == (0, ""), ended.output
    assert baselines_in(again) == {"a-1": "a-1", "a-2": "a-2"}
    (first / "results.jsonl").write_text("{")
    ended = CliRunner().invoke(main, arguments)
    assert ended.exit_code == 0, ended.output
    assert "note: the page has no course of the baseline: pvc://" in ended.stderr
    assert baselines_in(again) == {}


def test_a_baseline_that_is_gone_costs_the_report_its_courses_alone(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    rows = [make_row(f"a-{n}", fragment=f"a-{n}") for n in range(3)]
    first = publish(tmp_path, rows)
    uri = f"pvc://results/{first.relative_to(tmp_path)}"

    def gone(*_arguments: object) -> None:
        raise StorageError("it is gone")

    monkeypatch.setattr("bagpipe.driver.artefacts.baseline_rows", gone)
    second = publish(tmp_path, rows, uid="uid-2", baseline={"results": uri})
    assert baselines_in(second / "report.html") == {}
    assert (second / "comparison.json").exists()


def test_missing_cases_of_the_earlier_job_are_reported(tmp_path: Path) -> None:
    first = publish(tmp_path, [make_row(f"a-{n}", fragment=f"a-{n}") for n in range(3)])
    uri = f"pvc://results/{first.relative_to(tmp_path)}"
    now = [make_row("a-0", fragment="a-0")]
    second = publish(tmp_path, now, uid="uid-2", baseline={"results": uri})
    page = (second / "report.html").read_text()
    assert "2 regressed (2 missing) of 1 case; 2 missing" in page
    assert "Missing, which the baseline has: 2" in page
    # A comparison that was stored before this field existed is drawn as well.
    stored = json.loads((second / "comparison.json").read_text())
    del stored["comparisons"][0]["missing"]
    manifest = json.loads((second / "manifest.json").read_text())
    assert b"2 regressed (2 missing)" in Report(None, "").html(manifest, stored["comparisons"])


def test_of_an_earlier_job_with_variants_its_first_one_counts(tmp_path: Path) -> None:
    """By its manifest: the lines are in the order of the names, where pr-812 comes first."""
    both = [{"name": "released"}, {"name": "pr-812"}]
    first = publish(tmp_path, versions(failing={3}), variants=both)
    uri = f"pvc://results/{first.relative_to(tmp_path)}"
    now = [row for row in versions(failing={3}) if row["variant"] == "pr-812"]
    second = publish(tmp_path, now, uid="uid-2", variants=both[1:], baseline={"results": uri})
    [comparison] = json.loads((second / "comparison.json").read_text())["comparisons"]
    assert [case["case"] for case in comparison["regressed"]] == ["a-0003-pr-812"]


def test_a_missing_baseline_is_reported_before_anything_runs(tmp_path: Path) -> None:
    storage = Storage({"results": str(tmp_path)})
    with pytest.raises(StorageError, match=r"write status\.results of a finished job"):
        check_baseline("pvc://results/none", storage)


@pytest.mark.parametrize("line", ["{", "[1]", "7"])
def test_a_damaged_baseline_names_its_line(tmp_path: Path, line: str) -> None:
    stored(tmp_path, '{"case": "a", "outcome": "passed"}\n' + line + "\n", 2)
    with pytest.raises(StorageError, match=r"results\.jsonl line 2 is no row"):
        list(baseline_rows("pvc://results/", Storage({"results": str(tmp_path)})))


def test_the_page_and_the_job_are_published(tmp_path: Path) -> None:
    rows = [
        row | {"variant": row["variant"], "values": {"rain": "on"}} for row in versions(failing={3})
    ]
    folder = publish(
        tmp_path,
        rows,
        variants=[{"name": "released"}, {"name": "pr-812", "command": ["other"]}],
        evaluate=[{"name": "there", "presence": {"topic": "/out", "min": 2}}],
    )
    page = (folder / "report.html").read_text()
    assert "<title>Failed: drive</title>" in page
    assert "1 regressed of 6 cases" in page
    kept = read_job(folder / "job.json")
    spec = make_job(
        {},
        variants=[{"name": "released"}, {"name": "pr-812", "command": ["other"]}],
        evaluate=[{"name": "there", "presence": {"topic": "/out", "min": 2}}],
    ).spec
    assert kept == ("drive", spec)


def test_a_page_that_can_t_be_made_costs_no_verdict(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def break_off(*_arguments: object) -> bytes:
        raise KeyError("a fault of ours")

    monkeypatch.setattr("bagpipe.report.html.render", break_off)
    folder = publish(tmp_path, [make_row("a-0000")])
    assert (folder / "results.jsonl").exists()
    assert not (folder / "report.html").exists()


FORMS = ["job.json", "junit.xml", "report.html", "results.parquet"]


@pytest.mark.parametrize(
    ("broken", "lost"),
    [
        ("bagpipe.report.table.TableWriter.__init__", {"results.parquet"}),
        ("bagpipe.report.table.TableWriter.add", {"results.parquet"}),
        ("bagpipe.driver.artefacts.write_junit", {"junit.xml"}),
        ("bagpipe.report.html.Report.add", {"report.html"}),
        ("bagpipe.report.spool.tempfile.TemporaryFile", {"report.html"}),
        ("bagpipe.driver.artefacts.job_manifest", {"job.json"}),
        ("tempfile.TemporaryDirectory.__init__", {"results.parquet", "junit.xml"}),
    ],
)
def test_a_form_that_can_t_be_made_costs_itself_alone(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, broken: str, lost: set[str]
) -> None:
    def full(*_arguments: object, **_named: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(broken, full)
    folder = publish(tmp_path, [make_row("a-0000")])
    assert (folder / "results.jsonl").exists()
    assert {name for name in FORMS if not (folder / name).exists()} == lost


def test_a_comparison_that_can_t_be_made_costs_itself_alone(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def break_off(*_arguments: object) -> None:
        raise ZeroDivisionError

    monkeypatch.setattr("bagpipe.compare.compare.compare", break_off)
    variants = [{"name": "released"}, {"name": "pr-812"}]
    folder = publish(tmp_path, versions(failing=set()), variants=variants)
    assert not (folder / "comparison.json").exists()
    assert {name for name in FORMS if not (folder / name).exists()} == set()
    # All cases passed, and still it is not known what was asked: that is no Passed.
    manifest = json.loads((folder / "manifest.json").read_text())
    assert (manifest["phase"], manifest["counts"]["passed"]) == ("Complete", 12)
    assert (manifest["verdict"], manifest["verdictReason"]) == ("Invalid", "ComparisonFailed")


def test_the_page_on_results_names_every_key() -> None:
    page = (Path(__file__).parents[3] / "docs/reference/results.md").read_text()
    case = Case("a", "pvc://r/a.bag", "v", Window(0, 1, 2), [], [], 1)
    finding = Finding("n", "rate", "failed", course={})
    compared = Comparison("a", "b", "same", "", {}, {}, [], [], [], [])
    keys = ["schema", "criteria", *lost_row(case, 1), *finding.as_row(), *compared.as_json()]
    keys += [field.name for field in SCHEMA]
    assert [key for key in keys if f"`{key}`" not in page] == []
