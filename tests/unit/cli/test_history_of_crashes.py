"""Nights in which nothing was judged, or that left no results, are no good nights."""

import json
from pathlib import Path

import pytest
from click.testing import CliRunner

from bagpipe.cli.__main__ import main
from bagpipe.history.findings import history_of
from bagpipe.history.run import CaseOfRun, Found, Run
from tests.unit.bagpipe.jobs import make_row
from tests.unit.report.publishing import publish


def night(number: int, outcome: str, found: str | None) -> Run:
    """Twenty cases that all end so, with what their criterion found, None for nothing."""
    criteria = () if found is None else (Found("lane", found, None, "m"),)
    cases = tuple(CaseOfRun(f"a-{n:04d}", outcome, 4.0, 0, criteria) for n in range(20))
    verdict = {"passed": "Passed", "failed": "Failed", "invalid": "Invalid"}.get(outcome, "")
    return Run(f"results/{number}", f"2026-10-{number + 1:02d}T04:00:00Z", verdict, cases)


@pytest.mark.parametrize(
    ("outcome", "found"),
    [("failed", None), ("invalid", "invalid"), ("errored", None)],
    ids=["every case crashes", "no case has evidence", "every case errs"],
)
def test_what_does_not_work_at_all_any_more_got_worse(outcome: str, found: str | None) -> None:
    good = [night(number, "passed", "passed") for number in range(10)]
    bad = [night(number, outcome, found) for number in range(10, 20)]
    history = history_of(good + bad)
    # What the command's exit status asks (cli/history.py): 1 if something got worse.
    assert history.regressions, "exit status 0: nothing got worse"


def test_nights_that_ended_without_results_are_named(tmp_path: Path) -> None:
    """A job that hangs is ended by its deadline, and leaves a journal and no manifest."""
    publish(tmp_path, [make_row("a", recorded=None)], uid="good")
    for number in range(10):
        (tmp_path / f"out/drive/hung-{number}/journal").mkdir(parents=True)
        (tmp_path / f"out/drive/hung-{number}/journal/0001-x-000000.jsonl").write_text("{}\n")
    ended = CliRunner().invoke(main, ["history", str(tmp_path)])
    # Status 0, "the last: Passed", and no word of ten nights.
    assert "hung-9" in ended.output or ended.exit_code != 0, ended.output


def test_the_command_as_a_pipeline_asks_it_after_ten_nights_of_crashes(tmp_path: Path) -> None:
    found = {
        "name": "lane", "kind": "error", "outcome": "passed", "figure": 0.4, "unit": "m",
        "message": "", "limit": "at most 1 m", "expected_failure": False,
    }  # fmt: skip
    for number in range(20):
        if number < 10:
            rows = [make_row(f"a-{n}", criteria=[found], recorded=None) for n in range(8)]
        else:
            # As run/case_run.py has it: a stack that crashed has no criteria.
            rows = [make_row(f"a-{n}", "failed", "StackCrashed") for n in range(8)]
        folder = publish(tmp_path, rows, uid=f"uid-{number}")
        manifest = json.loads((folder / "manifest.json").read_text())
        manifest["provenance"]["ended"] = f"2026-10-{number + 1:02d}T04:00:00Z"
        (folder / "manifest.json").write_text(json.dumps(manifest))
    ended = CliRunner().invoke(main, ["history", str(tmp_path)])
    assert ended.exit_code == 1, ended.output
