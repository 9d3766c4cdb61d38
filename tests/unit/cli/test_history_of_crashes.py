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


def night_of_a_known_fault(number: int, *others: tuple[str, str]) -> Run:
    """Twenty cases that fail one criterion as ever, and what two others found in most of them."""
    known = Found("known fault", "failed", 2.0, "m")
    cases = []
    for case in range(20):
        found = [Found(name, outcome if case else "passed", None, "") for name, outcome in others]
        cases.append(CaseOfRun(f"a-{case:04d}", "failed", 1.0, 0, (known, *found)))
    return Run(f"results/{number}", f"2026-10-{number + 1:02d}", "Failed", tuple(cases))


def test_a_criterion_that_is_not_judged_any_more_is_named_also_where_another_fails_as_ever() -> (
    None
):
    good = [night_of_a_known_fault(n, ("gap", "passed"), ("lane", "passed")) for n in range(10)]
    blind = [
        night_of_a_known_fault(n, ("gap", "invalid"), ("lane", "passed")) for n in range(10, 20)
    ]
    history = history_of(good + blind)
    [worse] = history.regressions
    assert (worse.name, worse.worse) == ("gap: not judged", 10)
    assert [night.failed for night in worse.nights] == [0] * 10 + [19] * 10
    assert len(worse.cases) == 19
    names = [each.name for each in history.criteria]
    assert names == ["known fault", "gap", "lane", "gap: not judged"]
    # It is over, and what was never judged is none the worse.
    assert history_of(good + blind + good).regressions == []
    assert history_of(blind).regressions == []


def test_a_case_that_nothing_decided_is_named_once() -> None:
    nights = [night(n, "invalid" if n >= 10 else "passed", "invalid" if n >= 10 else "passed")
              for n in range(20)]  # fmt: skip
    assert [each.name for each in history_of(nights).regressions] == ["cases: not judged"]


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
