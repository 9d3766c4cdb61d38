"""`bagpipe history`: thirty simulated nights, with what got worse in them, and what did not."""

import json
import random
import re
from pathlib import Path
from typing import Any

import pyarrow.parquet as pq
import pytest
from click.testing import CliRunner

from bagpipe.cli.__main__ import main
from bagpipe.history.findings import history_of
from bagpipe.history.run import CaseOfRun, Found, Run, read_run
from bagpipe.history.steps import more_fail_since, moved_since
from bagpipe.storage import Storage
from tests.unit.bagpipe.jobs import make_row
from tests.unit.report.publishing import publish

NIGHTS = 30
BROKE = 20
CASES = [f"a-{number:04d}" for number in range(20)]
REGRESSED = ["a-0003", "a-0007", "a-0011"]


def judged(name: str, figure: float, limit: float) -> dict[str, Any]:
    outcome = "passed" if figure <= limit else "failed"
    found = {"name": name, "kind": "error", "outcome": outcome, "figure": figure, "unit": "m"}
    return found | {"message": "", "limit": f"at most {limit} m", "expected_failure": False}


def night(number: int, luck: random.Random) -> list[dict[str, Any]]:
    """A night's rows: "lane" breaks in three cases from night 20 on, "pose" fails by chance in one
    case, and "speed" gets slower by a tenth from night 10 on and fails nowhere.
    """
    rows = []
    for case in CASES:
        broken = number >= BROKE and case in REGRESSED
        criteria = [
            judged("lane", (1.4 if broken else 0.4) + luck.uniform(-0.1, 0.1), 1.0),
            judged("pose", 2.0 if case == "a-0015" and luck.random() < 0.3 else 0.5, 1.0),
            judged("speed", (0.22 if number >= 10 else 0.2) + luck.uniform(-0.005, 0.005), 1.0),
        ]
        failed = any(each["outcome"] == "failed" for each in criteria)
        outcome = "failed" if failed else "passed"
        seconds = 30.0 if case == "a-0009" else 4.0
        rows.append(make_row(case, outcome, criteria=criteria, seconds=seconds, recorded=None))
    return rows


@pytest.fixture(scope="module")
def nights(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Results as a schedule leaves them; they end a day apart."""
    folder = tmp_path_factory.mktemp("nights")
    luck = random.Random(7)  # noqa: S311  chance, not secrecy
    for number in range(NIGHTS):
        results = publish(folder, night(number, luck), uid=f"uid-{number}")
        manifest = json.loads((results / "manifest.json").read_text())
        manifest["provenance"]["ended"] = f"2026-10-{number + 1:02d}T04:00:00Z"
        manifest["job"]["name"] = f"nightly-{number:02d}"
        (results / "manifest.json").write_text(json.dumps(manifest))
    return folder


def history(folder: Path, *more: str) -> tuple[int, str]:
    ended = CliRunner().invoke(main, ["history", str(folder), *more])
    assert ended.exception is None or isinstance(ended.exception, SystemExit), ended.exception
    return ended.exit_code, ended.output


def test_thirty_nights_name_the_night_and_the_cases_since_which_a_criterion_fails(
    nights: Path,
) -> None:
    status, text = history(nights, "--output", "json")
    assert status == 1
    found = json.loads(text)
    assert [run["ended"][:10] for run in found["runs"]] == [
        f"2026-10-{day:02d}" for day in range(1, 31)
    ]
    criteria = {each["name"]: each for each in found["criteria"]}
    lane = criteria["lane"]
    assert lane["worse_since"]["ended"].startswith("2026-10-21")
    assert lane["worse_since"]["results"].endswith("uid-20")
    assert lane["cases"] == REGRESSED
    assert lane["failed"] == [0] * 20 + [3] * 10
    assert lane["judged"] == [20] * 30
    # Three cases of twenty don't move the median.
    assert lane["moved_since"] is None
    assert criteria["pose"]["worse_since"] is None
    assert criteria["speed"]["worse_since"] is None
    assert criteria["speed"]["moved_since"]["ended"].startswith("2026-10-11")
    assert [each["case"] for each in found["flaky"]] == ["a-0015"]
    assert found["flaky"][0]["of"] == 29
    assert found["slowest"][0] == {"case": "a-0009", "seconds": 30.0}


def test_the_table_has_it_in_a_sentence(nights: Path) -> None:
    status, text = history(nights)
    assert status == 1
    joined = " ".join(re.sub(r"\s+", " ", text).split())
    assert "30 runs, 2026-10-01 to 2026-10-30; the last: Failed" in joined
    for words in ("worse since 2026-10-21", "30 of 200 failed, 0 of 400 before", "a-0003"):
        assert all(word in joined for word in words.split()), (words, joined)
    assert "flaky: a-0015" in joined
    assert "slow: a-0009, 30.0 s" in joined


def test_before_it_broke_nothing_is_worse(nights: Path, tmp_path: Path) -> None:
    for number in range(BROKE):
        source = next(nights.rglob(f"uid-{number}"))
        target = tmp_path / f"nightly-{number:02d}" / source.name
        target.mkdir(parents=True)
        for name in ("manifest.json", "results.parquet"):
            (target / name).write_bytes((source / name).read_bytes())
    assert history(tmp_path)[0] == 0
    assert history(tmp_path, "--job", "nightly-0*", "--output", "json")[0] == 0


def test_runs_are_chosen_by_job_and_number(nights: Path) -> None:
    found = json.loads(history(nights, "--job", "nightly-0*", "--output", "json")[1])
    assert len(found["runs"]) == 10
    found = json.loads(history(nights, "--last", "3", "--output", "json")[1])
    assert [run["ended"][:10] for run in found["runs"]] == [
        "2026-10-28",
        "2026-10-29",
        "2026-10-30",
    ]
    status, text = history(nights, "--job", "weekly")
    assert (status, "has no results of a job weekly that has ended" in text) == (2, True)


def test_a_run_without_a_table_is_passed_over_and_named(nights: Path, tmp_path: Path) -> None:
    for number, table in ((0, True), (1, False), (2, None)):
        source = next(nights.rglob(f"uid-{number}"))
        target = tmp_path / source.name
        target.mkdir()
        (target / "manifest.json").write_bytes((source / "manifest.json").read_bytes())
        if table is not None:
            data = (source / "results.parquet").read_bytes()
            (target / "results.parquet").write_bytes(data if table else data[:100])
    ended = CliRunner().invoke(main, ["history", str(tmp_path), "--output", "json"])
    assert ended.exit_code == 0
    assert len(json.loads(ended.stdout)["runs"]) == 1
    assert ended.stderr.count("note: ") == 2
    assert "uid-1/results.parquet is no table of results" in ended.stderr


def test_the_page_needs_no_script_and_escapes_names(tmp_path: Path) -> None:
    bad = "<script>alert(1)</script>"
    row = make_row(bad, "failed", criteria=[judged("<b>lane</b>", 2.0, 1.0)], recorded=None)
    publish(tmp_path, [row])
    target = tmp_path / "history.html"
    assert history(tmp_path, "--page", str(target))[0] == 0
    text = target.read_text()
    assert "<script" not in text
    assert "&lt;script&gt;alert(1)" in text
    assert "&lt;b&gt;lane&lt;/b&gt;" in text


def test_the_page_has_a_square_for_each_night(nights: Path, tmp_path: Path) -> None:
    target = tmp_path / "history.html"
    history(nights, "--page", str(target))
    text = target.read_text()
    # Runs, three criteria, and the four cases that did not always pass.
    assert text.count("<i ") == NIGHTS * (1 + 3 + 4)
    assert "more fail since 2026-10-21" in text
    assert "other figures since 2026-10-11" in text
    assert text.count("<polyline") == 3


@pytest.mark.parametrize(
    ("failed", "since"),
    [
        ([0] * 10 + [5] * 5, 10),
        ([2] * 10 + [9] * 5, 10),
        # It is over.
        ([0] * 10 + [5] * 4 + [0], None),
        ([5] * 10 + [0] * 5, None),
        ([1, 0, 2, 0, 1, 1, 0, 2, 1, 0, 1, 2, 0, 1, 1], None),
        # One bad night is no chance at 12 of 20.
        ([0] * 14 + [12], 14),
        ([0] * 14 + [2], None),
        ([3], None),
        ([], None),
    ],
)
def test_more_fail_where_chance_does_not_explain_it(failed: list[int], since: int | None) -> None:
    assert more_fail_since(failed, [20] * len(failed)) == since


def test_runs_without_evidence_are_no_news() -> None:
    assert more_fail_since([0, 0, 0, 8, 0], [20, 20, 20, 20, 0]) == 3
    assert more_fail_since([0, 0, 0, 0], [0, 0, 0, 0]) is None


@pytest.mark.parametrize(
    ("values", "since"),
    [
        ([1.0 + n / 100 for n in range(10)] + [2.0 + n / 100 for n in range(10)], 10),
        ([1.0] * 20, None),
        ([1.0, 2.0] * 10, None),
        ([1.0 + n / 100 for n in range(10)] + [None] * 5 + [2.0 + n / 100 for n in range(10)], 15),
        ([1.0, 1.0, 2.0, 2.0], None),
    ],
)
def test_figures_moved_where_their_order_says_so(
    values: list[float | None], since: int | None
) -> None:
    assert moved_since(values) == since


def test_chance_alone_is_seldom_a_change() -> None:
    luck = random.Random(3)  # noqa: S311  chance, not secrecy
    trials = 300
    worse = moved = 0
    for _ in range(trials):
        failed = [sum(luck.random() < 0.1 for _ in range(20)) for _ in range(30)]
        worse += more_fail_since(failed, [20] * 30) is not None
        moved += moved_since([luck.gauss(1, 0.1) for _ in range(30)]) is not None
    # At 1 % three of 300 are expected at most, and eight would come in 1 of 100 such tests.
    assert worse <= 8
    assert moved <= 8


def test_a_table_of_before_there_was_a_quarantine_is_read(tmp_path: Path) -> None:
    rules = [{"cases": "a-1", "reason": "issue 17", "until": "2026-12-31"}]
    folder = publish(tmp_path, [make_row("a-0"), make_row("a-1")], quarantine=rules)
    listed = {"results": f"file://{folder}", "ended": "2026-11-23", "verdict": "Passed"}
    words = "in quarantine until 2026-12-31: issue 17"
    found = read_run(listed, Storage({}), 1_000)
    assert [case.quarantine for case in found.cases] == ["", words]
    table = pq.read_table(folder / "results.parquet")
    pq.write_table(table.drop_columns(["quarantine"]), folder / "results.parquet")
    found = read_run(listed, Storage({}), 1_000)
    assert [(case.name, case.quarantine) for case in found.cases] == [("a-0", ""), ("a-1", "")]


def test_what_is_in_quarantine_makes_nothing_worse_and_is_listed() -> None:
    def run(number: int, words: str) -> Run:
        broken = number >= 5
        cases = tuple(
            CaseOfRun(
                f"a-{case}", "failed" if broken and case < 4 else "passed", 1.0, 0,
                (Found("lane", "failed" if broken and case < 4 else "passed", 1.0, "m"),),
                words if case < 5 else "",
            )
            for case in range(10)
        )  # fmt: skip
        return Run(f"r{number}", f"2026-10-{number + 1:02d}", "Passed", cases)

    counting = history_of([run(number, "") for number in range(10)])
    assert [each.worse for each in counting.criteria] == [5]
    assert counting.quarantined == ()
    found = history_of([run(number, "in quarantine" * (number >= 5)) for number in range(10)])
    assert found.regressions == []
    listed = [(each.case, each.passed, each.of) for each in found.quarantined]
    assert listed == [*((f"a-{case}", 5, 10) for case in range(4)), ("a-4", 10, 10)]


@pytest.mark.parametrize("inside", [range(5), range(5, 10)])
def test_a_quarantine_that_begins_or_ends_hides_nothing_and_is_no_change(inside: range) -> None:
    """Four cases fail in all runs, and are in quarantine in half of them; four others break."""

    def run(number: int, *, breaks: bool) -> Run:
        failed = {*range(4), *(range(4, 8) if breaks and number >= 5 else ())}
        words = "in quarantine" if number in inside else ""
        cases = tuple(
            CaseOfRun(
                f"a-{case}", "passed", 1.0, 0,
                (Found("lane", "failed" if case in failed else "passed", 1.0, "m"),),
                words if case < 4 else "",
            )
            for case in range(12)
        )  # fmt: skip
        return Run(f"r{number}", f"2026-10-{number + 1:02d}", "Passed", cases)

    steady = history_of([run(number, breaks=False) for number in range(10)])
    assert steady.regressions == []
    found = history_of([run(number, breaks=True) for number in range(10)])
    assert [each.worse for each in found.regressions] == [5]
    assert found.regressions[0].cases == ("a-4", "a-5", "a-6", "a-7")


def test_a_case_that_broke_once_is_not_flaky_and_errors_of_machines_are_no_flips() -> None:
    def run(number: int, **outcomes: str) -> Run:
        found = (Found("lane", "passed", 1.0, "m"),)
        cases = tuple(CaseOfRun(case, each, 1.0, 0, found) for case, each in outcomes.items())
        return Run(f"r{number}", f"2026-10-{number:02d}", "Passed", cases)

    runs = [
        run(1, broke="passed", flips="passed", machine="passed"),
        run(2, broke="passed", flips="failed", machine="errored"),
        run(3, broke="failed", flips="passed", machine="passed"),
        run(4, broke="failed", flips="passed", machine="errored"),
    ]
    assert [(each.case, each.flips, each.of) for each in history_of(runs).flaky] == [
        ("flips", 2, 3)
    ]
