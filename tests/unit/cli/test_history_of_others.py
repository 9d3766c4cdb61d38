"""`bagpipe history` of results that it did not write, that are damaged, or that are very many."""

import json
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from click.testing import CliRunner, Result

from bagpipe.cli import history as history_module
from bagpipe.cli.__main__ import main
from bagpipe.report.table import SCHEMA
from tests.unit.bagpipe.jobs import make_row
from tests.unit.report.publishing import publish

Lines = list[dict[str, Any]]


def found(name: str, figure: Any, outcome: str = "passed") -> dict[str, Any]:
    return {"name": name, "kind": "error", "outcome": outcome, "figure": figure, "unit": "m"}


def results(tmp_path: Path, number: int, **manifest: Any) -> Path:
    """A run of one case that passed, whose manifest is changed."""
    row = make_row("a-0000", criteria=[found("lane", 0.5)], seconds=1.0)
    folder = publish(tmp_path, [row], uid=f"uid-{number}")
    text = json.loads((folder / "manifest.json").read_text())
    text["provenance"]["ended"] = f"2026-10-{number + 1:02d}T04:00:00Z"
    ended = manifest.pop("ended", None)
    if ended is not None:
        text["provenance"]["ended"] = ended
    (folder / "manifest.json").write_text(json.dumps(text | manifest))
    return folder


def history(folder: Path, *more: str) -> Result:
    ended = CliRunner().invoke(main, ["history", str(folder), *more])
    assert ended.exception is None or isinstance(ended.exception, SystemExit), ended.exception
    assert "unexpected fault" not in ended.stderr, ended.stderr
    return ended


def strict(text: str) -> dict[str, Any]:
    """JSON as others read it, which has no NaN."""

    def refuse(constant: str) -> None:
        raise ValueError(constant)

    read: dict[str, Any] = json.loads(text, parse_constant=refuse)
    return read


def rewrite(folder: Path, lines: Lines, schema: pa.Schema = SCHEMA) -> None:
    pq.write_table(pa.Table.from_pylist(lines, schema=schema), folder / "results.parquet")


def line(case: Any = "a-0000", **changed: Any) -> dict[str, Any]:
    made = {"case": case, "outcome": "passed", "seconds": 1.0, "discarded": [], "criteria": []}
    return made | changed


@pytest.mark.parametrize("odd", [float("nan"), float("inf"), float("-inf")])
def test_a_figure_that_is_no_number_is_none(tmp_path: Path, odd: float) -> None:
    figures = [0.5, odd, 0.7, 0.9]
    folder = results(tmp_path, 0)
    rewrite(
        folder,
        [
            line(f"a-{n}", criteria=[found("lane", figure), found("odd", odd)])
            for n, figure in enumerate(figures)
        ],
    )
    page = tmp_path / "history.html"
    ended = history(tmp_path, "--output", "json", "--page", str(page))
    criteria = {each["name"]: each for each in strict(ended.stdout)["criteria"]}
    assert criteria["lane"]["median"] == [0.7]
    assert criteria["odd"]["median"] == [None]
    assert criteria["odd"]["judged"] == [4]
    assert not {"nan", "inf"} & set(page.read_text().replace(",", " ").replace('"', " ").split())


def test_seconds_that_are_no_number_are_none(tmp_path: Path) -> None:
    folder = results(tmp_path, 0)
    rewrite(folder, [line("a-0", seconds=float("nan")), line("a-1", seconds=2.0)])
    slowest = strict(history(tmp_path, "--output", "json").stdout)["slowest"]
    assert slowest == [{"case": "a-1", "seconds": 2.0}, {"case": "a-0", "seconds": 0.0}]


def test_a_table_that_is_damaged_anywhere_is_passed_over_and_named(tmp_path: Path) -> None:
    results(tmp_path, 0)
    folder = results(tmp_path, 1)
    whole = (folder / "results.parquet").read_bytes()
    for begin in range(4, len(whole) - 8, 197):
        damaged = bytearray(whole)
        damaged[begin : begin + 60] = bytes(min(60, len(whole) - begin))
        (folder / "results.parquet").write_bytes(damaged)
        ended = history(tmp_path, "--output", "json")
        assert (ended.exit_code, "written" in ended.stderr) == (0, False), (begin, ended.stderr)
        runs = len(strict(ended.stdout)["runs"])
        assert runs + ended.stderr.count("note: ") == 2, (begin, ended.stderr)


def _other(name: str, kind: Any) -> pa.Schema:
    return pa.schema([pa.field(f.name, kind if f.name == name else f.type) for f in SCHEMA])


@pytest.mark.parametrize(
    ("schema", "lines"),
    [
        (SCHEMA, [line(None)]),
        (SCHEMA, [line(outcome=None)]),
        (SCHEMA, [line(criteria=[found("x", 1.0) | {"name": None}])]),
        (SCHEMA, [line(criteria=[found("x", 1.0) | {"outcome": None}])]),
        (SCHEMA, [line(criteria=[None])]),
        (_other("case", pa.int64()), [line(5)]),
        (_other("seconds", pa.string()), [line(seconds="1")]),
        (_other("criteria", pa.list_(pa.string())), [line(criteria=["x"])]),
        (_other("discarded", pa.int64()), [line(discarded=3)]),
        (
            _other("criteria", pa.list_(pa.struct([(n, pa.string()) for n in found("", "")]))),
            [line(criteria=[found("x", "1")])],
        ),
        (pa.schema([("case", pa.string())]), [{"case": "a-0000"}]),
    ],
)
def test_a_table_of_other_columns_is_passed_over_and_named(
    tmp_path: Path, schema: pa.Schema, lines: Lines
) -> None:
    results(tmp_path, 0)
    # Beside a case of the usual kind, with which it would be sorted.
    rewrite(results(tmp_path, 1), lines, schema)
    ended = history(tmp_path, "--output", "json", "--page", str(tmp_path / "history.html"))
    assert ended.exit_code == 0
    assert len(strict(ended.stdout)["runs"]) == 1
    assert "uid-1/results.parquet is no table of results" in ended.stderr


@pytest.mark.parametrize("many", ["rows", "findings"])
def test_a_small_file_of_very_many_lines_is_not_read(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, many: str
) -> None:
    results(tmp_path, 0)
    folder = results(tmp_path, 1)
    count = 100_000
    criteria = [] if many == "rows" else [found("x", 1.0)] * 50
    rewrite(folder, [line(criteria=criteria)] * (count if many == "rows" else count // 50))
    assert (folder / "results.parquet").stat().st_size < 20_000
    monkeypatch.setattr(history_module, "_MOST_VALUES", count - 1)
    ended = history(tmp_path, "--output", "json")
    assert len(strict(ended.stdout)["runs"]) == 1
    assert "uid-1/results.parquet has more than 99,999 cases or findings" in ended.stderr
    # Of both together, and the older one has none left.
    values = count if many == "rows" else count + count // 50
    monkeypatch.setattr(history_module, "_MOST_VALUES", values)
    assert "uid-0/results.parquet has more than 0 cases" in history(tmp_path).stderr
    monkeypatch.setattr(history_module, "_MOST_VALUES", values + 1)
    assert len(strict(history(tmp_path, "--output", "json").stdout)["runs"]) == 2


def test_what_a_manifest_says_is_no_markup_and_no_command(tmp_path: Path) -> None:
    results(tmp_path, 0, verdict="[/red]\x1b[2J\ud800", ended="[/]\x1b]0;owned\x07")
    ended = history(tmp_path)
    assert ended.exit_code == 0
    assert "\x1b" not in ended.stdout
    assert "[/red]" in ended.stdout
    page = tmp_path / "history.html"
    assert history(tmp_path, "--page", str(page)).exit_code == 0
    assert "[/red]" in page.read_text()


def test_a_manifest_that_cannot_be_read_is_named(tmp_path: Path) -> None:
    results(tmp_path, 0)
    (results(tmp_path, 1) / "manifest.json").write_text("{")
    # One that still runs has none, which is no news.
    (results(tmp_path, 2) / "manifest.json").unlink()
    ended = history(tmp_path, "--output", "json")
    assert len(strict(ended.stdout)["runs"]) == 1
    notes = [each for each in ended.stderr.splitlines() if each.startswith("note: ")]
    assert len(notes) == 1
    assert notes[0].endswith("uid-1: its manifest can't be read")


def test_a_page_that_cannot_be_written_is_named(tmp_path: Path) -> None:
    results(tmp_path, 0)
    page = tmp_path / "no folder" / "history.html"
    ended = history(tmp_path, "--page", str(page))
    assert ended.exit_code == 2
    assert f"{page} can't be written: No such file or directory" in ended.stderr
