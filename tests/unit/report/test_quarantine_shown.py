"""What is in quarantine is seen wherever cases are seen, and nowhere as passed."""

import json
import re
from pathlib import Path
from typing import Any

import pyarrow.parquet as pq
import pytest
from click.testing import CliRunner

from bagpipe.cli.__main__ import main
from bagpipe.report.words import sentence
from tests.unit.bagpipe.jobs import make_row
from tests.unit.report.publishing import publish

RULES = [
    {"cases": "a-[12]", "reason": "issue <17>", "until": "2026-12-31"},
    {"cases": "a-3", "reason": "issue 18", "until": "2026-11-22"},
    {"cases": "night-*", "reason": "issue 19", "until": "2026-11-23"},
]
ROWS = [
    make_row("a-0"), make_row("a-1", "failed", "CriteriaFailed"), make_row("a-2"), make_row("a-3"),
]  # fmt: skip
WORDS = "in quarantine until 2026-12-31: issue <17>"


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    return publish(tmp_path, ROWS, quarantine=RULES)


def page_of(html: str) -> tuple[str, dict[str, Any]]:
    """The text around the data, and the data."""
    found = re.search(r'<script type="application/json" id="data">(.*?)</script>', html, re.DOTALL)
    assert found is not None
    data: dict[str, Any] = json.loads(found[1])
    return html.replace(found[1], ""), data


def test_the_report_shows_each_rule_and_what_to_do_about_it(folder: Path) -> None:
    frame, data = page_of((folder / "report.html").read_text())
    assert 'Passed<span class="against">: 1 failed, 1 of these in quarantine' in frame
    assert "3 of 4 cases passed; 1 did not and is in quarantine." in frame
    section = frame[frame.index('<section id="quarantine"') : frame.index('<section id="causes"')]
    cells = re.findall(r"<t[hd][^>]*>(.*?)</t[hd]>", section[section.index("<tbody>") :])
    assert cells == [
        "a-[12]", "2026-12-31", "issue &lt;17&gt;", "1", "1", "",
        "a-3", "2026-11-22 (ended)", "issue 18", "1", "0",
        "ended with 2026-11-22: its 1 case counts again",
        "night-*", "2026-11-23", "issue 19", "0", "0",
        "names no case of this job: correct its pattern, or remove it",
    ]  # fmt: skip
    column = data["cases"]["quarantine"]
    assert [column["values"][at] for at in column["at"]] == ["", WORDS, WORDS, ""]


def test_a_report_of_before_there_was_a_quarantine_is_made_again(folder: Path) -> None:
    manifest = json.loads((folder / "manifest.json").read_text())
    del manifest["quarantine"], manifest["counts"]["quarantined"]
    (folder / "manifest.json").write_text(json.dumps(manifest))
    again = folder / "again.html"
    assert CliRunner().invoke(main, ["report", str(folder), "--to", str(again)]).exit_code == 0
    assert 'id="quarantine"' not in again.read_text()


def test_where_all_passed_and_none_counts_the_report_says_why_that_is_no_pass(
    tmp_path: Path,
) -> None:
    rules = [{"cases": "*", "reason": "issue 17", "until": "2026-12-31"}]
    folder = publish(tmp_path, [make_row("a-0"), make_row("a-1")], quarantine=rules)
    frame = page_of((folder / "report.html").read_text())[0]
    assert "Not enough evidence" in frame
    assert "Of 2 cases none failed. All are in quarantine, so that no case counts." in frame


def test_the_same_verdict_is_in_a_report_that_is_made_later(folder: Path) -> None:
    again = folder / "again.html"
    assert CliRunner().invoke(main, ["report", str(folder), "--to", str(again)]).exit_code == 0
    first = page_of((folder / "report.html").read_text())[1]
    assert page_of(again.read_text())[1]["cases"] == first["cases"]


def test_results_name_it_and_end_as_the_verdict_does(folder: Path) -> None:
    ended = CliRunner().invoke(main, ["results", str(folder)], env={"COLUMNS": "200"})
    assert ended.exit_code == 0
    assert ended.output.startswith("Passed: 1 failed, 1 of these in quarantine  drive")
    assert f"{WORDS}; why a-1" in " ".join(ended.output.split())
    assert "quarantine of 'night-*': names no case of this job" in ended.output
    shown = CliRunner().invoke(main, ["results", str(folder), "--failed", "--output", "json"])
    found = json.loads(shown.output)
    assert [case["case"] for case in found["cases"]] == ["a-1"]
    assert found["cases"][0]["quarantine"] == RULES[0]
    assert found["counts"]["quarantined"] == 1
    assert [rule["holds"] for rule in found["quarantine"]["rules"]] == [True, False, True]


def test_the_table_has_it_as_a_column(folder: Path) -> None:
    table = pq.read_table(folder / "results.parquet")
    assert table.column("quarantine").to_pylist() == [None, WORDS, WORDS, None]


def test_a_comparison_names_what_got_worse_in_quarantine(tmp_path: Path) -> None:
    before = publish(tmp_path, [make_row(f"a-{n}") for n in range(4)], uid="before")
    after = publish(tmp_path, ROWS, uid="after", quarantine=RULES)
    ended = CliRunner().invoke(main, ["compare", str(before), str(after)])
    assert ended.exit_code == 0
    assert "no case changed of 2 cases; 1 worse in quarantine" in ended.output
    assert "in quarantine: a-1 is failed now" in ended.output
    rows = [make_row("a-0", "failed", "Bad"), *ROWS[1:]]
    worse = publish(tmp_path, rows, uid="worse", quarantine=RULES)
    assert CliRunner().invoke(main, ["compare", str(before), str(worse)]).exit_code == 1


@pytest.mark.parametrize(
    ("verdict", "planned", "counts", "words"),
    [
        ("Passed", 1, {"passed": 1}, "The one case passed."),
        (
            "Passed", 4, {"passed": 2, "quarantined": 2},
            "2 of 4 cases passed; 2 did not and are in quarantine.",
        ),
        (
            "Failed", 4, {"failed": 3, "quarantined": 2},
            "Of 4 cases 3 failed; 2 that did not pass are in quarantine.",
        ),
        (
            "Failed", 4, {"failed": 3, "quarantined": 1},
            "Of 4 cases 3 failed; 1 that did not pass is in quarantine.",
        ),
    ],
)  # fmt: skip
def test_the_sentence(verdict: str, planned: int, counts: dict[str, int], words: str) -> None:
    counted = dict.fromkeys(("passed", "failed", "invalid", "errored"), 0) | counts
    manifest = {"verdict": verdict, "counts": counted | {"planned": planned}}
    data = {"criteria": [], "cases": {"reason": {"values": [], "at": []}}}
    assert sentence(manifest, data) == words
