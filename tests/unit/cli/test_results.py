"""`bagpipe results`, `compare` and `report` over folders that a job has published."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
import yaml
from click.testing import CliRunner

from bagpipe.cli.__main__ import main
from tests.unit.bagpipe.jobs import make_row
from tests.unit.report.publishing import publish, versions

VARIANTS = [{"name": "released"}, {"name": "pr-812"}]


def run(*arguments: str | Path) -> tuple[int, str]:
    ended = CliRunner().invoke(main, [str(argument) for argument in arguments])
    assert ended.exception is None or isinstance(ended.exception, SystemExit), ended.exception
    return ended.exit_code, ended.output


@pytest.mark.parametrize(
    ("outcomes", "status", "verdict"),
    [
        (["passed"], 0, "Passed"),
        (["passed", "failed"], 1, "Failed: 1 failed"),
        (["passed", "invalid"], 1, "Invalid: 1 lack evidence"),
        (["passed", "errored"], 2, "No verdict: 1 errored"),
    ],
)
def test_the_status_is_the_verdict(
    tmp_path: Path, outcomes: list[str], status: int, verdict: str
) -> None:
    rows = [make_row(f"a-{n}", o, "" if o == "passed" else "Bad") for n, o in enumerate(outcomes)]
    folder = publish(tmp_path, rows)
    ended, text = run("results", folder)
    assert (ended, text.split("  ")[0]) == (status, verdict)
    assert ("why a-1" in text) == (len(outcomes) > 1)


@pytest.mark.parametrize(
    ("attempts", "sentence"),
    [(1, ""), (2, "1 run does not count: "), (4, "3 runs do not count: ")],
)
def test_runs_that_do_not_count_are_reported(tmp_path: Path, attempts: int, sentence: str) -> None:
    folder = publish(tmp_path, [make_row("a-0", attempts=attempts)])
    text = run("results", folder)[1]
    assert sentence in text
    assert ("not count" in text) == (attempts > 1)


def test_a_terminal_obeys_nothing_that_a_stack_or_a_rule_wrote(tmp_path: Path) -> None:
    hostile = "no\x1b[2J\x1b]0;mine\x07 [red]\r\nPassed  drive"
    rules = [{"cases": "a-1*", "reason": hostile, "until": "2026-12-31"}]
    names = ("a-0", "a-1\x1b[31m", "a-2")
    rows = [make_row(name, "failed", "Bad", message=hostile) for name in names]
    before = publish(tmp_path, [make_row(name) for name in names], uid="before")
    after = publish(tmp_path, rows, uid="after", quarantine=rules)
    for words in (("results", after), ("compare", before, after)):
        text = run(*words)[1]
        assert [letter for letter in text if not letter.isprintable() and letter != "\n"] == []
        assert not [line for line in text.splitlines() if line.startswith("Passed")]


def test_results_by_uri_and_only_the_failed_ones(tmp_path: Path) -> None:
    rows = [make_row("a-0"), make_row("a-1", "failed", "Bad", message="[red] is no markup")]
    folder = publish(tmp_path, rows)
    uri = f"pvc://results/{folder.relative_to(tmp_path)}"
    volume = ("--volume", f"results={tmp_path}")
    status, text = run("results", uri, *volume, "--failed", "--output", "json")
    found = json.loads(text)
    assert (status, found["verdict"], found["job"]["name"]) == (1, "Failed", "drive")
    assert [(case["case"], case["outcome"]) for case in found["cases"]] == [("a-1", "failed")]
    _, text = run("results", uri, *volume, "--output", "yaml")
    assert [case["case"] for case in yaml.safe_load(text)["cases"]] == ["a-0", "a-1"]
    assert "[red] is no markup" in run("results", uri, *volume)[1]


@pytest.mark.parametrize(
    ("where", "sentence"),
    [
        ("nowhere", "there is no file://"),
        ("pvc://results/x", "give --volume results=FOLDER"),
        ("ftp://results/x", "has no known scheme"),
    ],
)
@pytest.mark.parametrize("verb", ["results", "report"])
def test_what_is_no_results_folder_ends_with_2(verb: str, where: str, sentence: str) -> None:
    status, text = run(verb, where)
    assert status == 2
    assert sentence in text
    assert "Traceback" not in text


def test_damaged_results_name_their_line(tmp_path: Path) -> None:
    folder = publish(tmp_path, [make_row("a-0")])
    (folder / "results.jsonl").write_text('{"case": 7}\n')
    status, text = run("results", folder)
    assert status == 2
    assert "results.jsonl line 1 is no row of results" in text


def test_a_worse_job_ends_with_1_and_names_its_cases(tmp_path: Path) -> None:
    before = publish(tmp_path, versions(failing=set()), uid="a", variants=VARIANTS)
    after = publish(tmp_path, versions(failing={3}), uid="b", variants=VARIANTS)
    status, text = run("compare", before, after)
    assert status == 1
    assert "regressed: a-0003-pr-812" in text
    assert "1 regressed of 6 cases" in text
    status, text = run("compare", after, before, "--output", "json")
    assert (status, [c["verdict"] for c in json.loads(text)]) == (0, ["same", "same"])


def test_jobs_without_a_common_case_can_t_be_compared(tmp_path: Path) -> None:
    before = publish(tmp_path, [make_row("a-0", fragment="a-0")], uid="a")
    after = publish(tmp_path, [make_row("b-0", fragment="b-0")], uid="b")
    status, text = run("compare", before, after)
    assert status == 1
    assert "1 regressed (1 missing) of 0 cases" in text
    status, text = run("compare", before, after, "--allow-missing")
    assert status == 2
    assert "no case of both could be compared: --allow-unknown lets that pass" in text
    assert run("compare", before, after, "--allow-missing", "--allow-unknown")[0] == 0


@pytest.mark.parametrize("outcome", ["failed", "invalid", "errored"])
def test_cases_that_passed_and_do_not_now_end_with_1_unless_that_is_allowed(
    tmp_path: Path, outcome: str
) -> None:
    before = publish(tmp_path, [make_row(f"a-{n}") for n in range(4)], uid="a")
    now = [make_row(f"a-{n}", outcome if n else "passed", "Why") for n in range(4)]
    after = publish(tmp_path, now, uid="b")
    status, text = run("compare", before, after)
    assert status == 1
    assert f"3 regressed (3 {outcome}): --allow-regressed lets that pass" in text
    assert f"regressed: a-1 is {outcome} now (Why)" in text
    status, text = run("compare", before, after, "--allow-regressed")
    assert (status, f"a-1 is {outcome} now" in text) == (0, True)


def with_figures(more: float, criterion: str = "latency") -> list[dict[str, Any]]:
    """A case of each of six recordings, with latencies of `more` seconds above the one before."""
    found = {"name": criterion, "outcome": "passed", "unit": "s", "direction": "lower"}
    return [
        make_row(f"a-{n}", bag=f"b{n}", criteria=[found | {"figure": 1 + more * (n + 1)}])
        for n in range(6)
    ]


def test_worse_figures_end_with_1_unless_that_is_allowed(tmp_path: Path) -> None:
    before = publish(tmp_path, with_figures(0.0), uid="a")
    after = publish(tmp_path, with_figures(0.1), uid="b")
    status, text = run("compare", before, after)
    assert (status, "worse in latency: --allow-worse-criteria lets that pass" in text) == (1, True)
    assert run("compare", before, after, "--allow-worse-criteria")[0] == 0
    assert run("compare", after, before)[0] == 0


def test_a_terminal_obeys_no_name_of_a_criterion_that_is_worse(tmp_path: Path) -> None:
    hostile = "lane\x1b]52;c;cm0gLXJmIH4=\x07"
    before = publish(tmp_path, with_figures(0.0, hostile), uid="a")
    after = publish(tmp_path, with_figures(0.1, hostile), uid="b")
    status, text = run("compare", before, after)
    assert (status, "--allow-worse-criteria lets that pass" in text) == (1, True)
    assert not {"\x1b", "\x07"} & set(text)


def test_what_looks_like_a_pictogram_is_shown_as_it_is(tmp_path: Path) -> None:
    folder = publish(tmp_path, [make_row("a-0", "failed", "Bad", message="node:camera:died")])
    assert "node:camera:died" in run("results", folder)[1]


def test_a_job_that_lost_cases_is_no_better_for_it(tmp_path: Path) -> None:
    before = publish(tmp_path, [make_row(f"a-{n}") for n in range(10)], uid="a")
    after = publish(tmp_path, [make_row("a-0")], uid="b")
    status, text = run("compare", before, after)
    assert status == 1
    assert "9 regressed (9 missing) of 1 case; 9 missing" in text
    assert "missing: a-9" in text
    assert "this job against the earlier job: 9 missing: --allow-missing lets that pass" in text
    status, text = run("compare", before, after, "--allow-missing")
    assert (status, "--allow-missing" in text) == (0, False)
    # New cases are nothing that was lost.
    status, text = run("compare", after, before, "--output", "json")
    assert (status, json.loads(text)[0]["counts"]["new"]) == (0, 9)


def test_a_variant_without_any_case_is_missing(tmp_path: Path) -> None:
    before = publish(tmp_path, versions(failing=set()), uid="a", variants=VARIANTS)
    rows = [row for row in versions(failing=set()) if row["variant"] == "pr-812"]
    after = publish(tmp_path, rows, uid="b", variants=VARIANTS)
    status, text = run("compare", before, after)
    assert status == 1
    assert "released against the earlier job: 6 missing: --allow-missing lets that pass" in text


def test_a_worse_job_stays_worse_whatever_may_be_missing(tmp_path: Path) -> None:
    before = publish(tmp_path, [make_row(f"a-{n}") for n in range(3)], uid="a")
    after = publish(tmp_path, [make_row("a-0", "failed")], uid="b")
    assert run("compare", before, after, "--allow-missing")[0] == 1


def test_the_page_is_made_again(tmp_path: Path) -> None:
    folder = publish(tmp_path, versions(failing={3}), variants=VARIANTS)
    page = tmp_path / "again.html"
    status, text = run("report", folder, "-o", page)
    assert status == 0
    assert text == f"{page}: {page.stat().st_size:,} bytes\n"
    made, first = page.read_text(), (folder / "report.html").read_text()
    uri = "pvc://results/out/drive/uid-1"
    assert made.replace(folder.as_uri(), uri).count("regressed") == first.count("regressed")
    assert "<title>Failed: drive</title>" in made
    status, text = run("report", folder, "--to", tmp_path / "no" / "page.html")
    assert (status, "can't be written: No such file" in text) == (2, True)


@pytest.mark.parametrize(("output", "read"), [("json", json.loads), ("yaml", yaml.safe_load)])
def test_the_page_s_place_is_printed_as_json_and_yaml(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, output: str, read: Callable[[str], Any]
) -> None:
    folder = publish(tmp_path, [make_row("a-0")])
    monkeypatch.chdir(tmp_path)
    status, text = run("report", folder, "--output", output)
    page = tmp_path / "report.html"
    assert (status, read(text)) == (0, {"uri": page.as_uri(), "bytes": page.stat().st_size})
    assert not (tmp_path / output).exists()
