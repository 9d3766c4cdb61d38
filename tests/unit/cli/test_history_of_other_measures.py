"""`bagpipe history` of a criterion that measured something else before, under the same name."""

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.parquet as pq
from click.testing import CliRunner

from bagpipe.cli.__main__ import main
from bagpipe.history.findings import CriterionHistory, Night, history_of
from bagpipe.history.run import CaseOfRun, Found, Measured, Run
from tests.unit.bagpipe.jobs import make_row
from tests.unit.report.publishing import publish

SIDE = 12
SLOW, FAST = [0.4 + 0.0001 * n for n in range(SIDE)], [0.05 + 0.0001 * n for n in range(SIDE)]


def over(marks: Sequence[str], figures: Sequence[float], broken: int = 99) -> CriterionHistory:
    """Nights of three cases, which fail from night `broken` on."""
    runs = []
    for number, (mark, figure) in enumerate(zip(marks, figures, strict=True)):
        outcome = "failed" if number >= broken else "passed"
        found = Found("late", outcome, figure, "s", measures=mark)
        cases = tuple(CaseOfRun(f"c{n}", outcome, 1.0, 0, (found,)) for n in range(3))
        runs.append(Run(f"r{number}", f"2026-10-{number + 1:02d}", "Passed", cases))
    return history_of(runs).criteria[0]


def test_figures_of_another_definition_are_none_of_this_one() -> None:
    found = over(["p50"] * SIDE + ["p99"] * SIDE, FAST + SLOW)
    assert (found.moved, found.worse) == (None, None)
    assert [night.median for night in found.nights] == [None] * SIDE + SLOW
    assert [night.judged for night in found.nights] == [3] * 2 * SIDE
    # What fails is counted whatever was measured: the job was changed to be stricter, or not.
    assert over(["p50"] * SIDE + ["p99"] * SIDE, FAST + SLOW, broken=SIDE).worse == SIDE


def test_nights_without_a_mark_are_compared_as_before() -> None:
    for marks in ([""] * SIDE + ["p99"] * SIDE, ["p99"] * SIDE + [""] * SIDE):
        found = over(marks, FAST + SLOW)
        assert (found.moved, [night.median for night in found.nights]) == (SIDE, FAST + SLOW)


def test_latencies_of_slow_plays_are_compared_with_those_of_one_as_slow() -> None:
    for before in ("", "p99", "slowed-0.1-p99"):
        found = over([before] * SIDE + ["slowed-0.5-p99"] * SIDE, FAST + SLOW)
        assert (found.moved, found.nights[0].median) == (None, None)
    found = over(["slowed-0.5-p99"] * SIDE * 2, FAST + SLOW)
    assert found.moved == SIDE


def test_the_newest_mark_that_is_known_decides() -> None:
    marks = ["p50"] * 3 + ["p99"] * 3 + [""] * 3
    found = over(marks, range(9))
    assert [night.median for night in found.nights] == [None] * 3 + [3, 4, 5, 6, 7, 8]
    # A mark without a figure is of nothing that was measured.
    silent = Found("late", "invalid", None, "s", measures="p50")
    runs = [
        Run("r1", "1", "Passed", (CaseOfRun("c", "passed", 1.0, 0, (found,)),))
        for found in (Found("late", "passed", 1.0, "s", measures="p99"), silent)
    ]
    assert [night.median for night in history_of(runs).criteria[0].nights] == [1.0, None]


def test_what_an_invalid_finding_was_judged_on_is_no_figure() -> None:
    def run(*found: Found) -> Run:
        cases = (CaseOfRun(f"c{n}", each.outcome, 1.0, 0, (each,)) for n, each in enumerate(found))
        return Run("r", "1", "Passed", tuple(cases))

    good = Found("late", "passed", 1.0, "s", measures="p99")
    dead = Found("late", "invalid", 0.01, "s", measures="p50")
    (late, *_) = history_of([run(good, good), run(good, dead), run(dead, dead)]).criteria
    assert late.nights == (Night(2, 0, 1.0), Night(1, 0, 1.0), Night(0, 0, None))


def test_each_of_several_figures_is_of_its_own_definition() -> None:
    def run(*measured: Measured) -> Run:
        found = Found("goal", "passed", measured[0].figure, measured[0].unit, measured)
        return Run("r", "1", "Passed", (CaseOfRun("c", "passed", 1.0, 0, (found,)),))

    before = run(Measured("m", 1.0, "here"), Measured("rad", 2.0, "north"))
    after = run(Measured("m", 3.0, "there"), Measured("rad", 4.0, "north"))
    medians = [[n.median for n in each.nights] for each in history_of([before, after]).criteria]
    assert medians == [[None, 3.0], [2.0, 4.0]]


def finding(figure: float, mark: str) -> dict[str, Any]:
    bounds = [
        {"outcome": "passed", "figure": figure * k, "unit": unit, "measures": f"{mark}{unit}"}
        for k, unit in enumerate(("m", "rad"), start=1)
    ]
    return {"name": "goal", "kind": "finalPose", "figures": bounds} | bounds[0]


def of_a_release_before(table: Path) -> None:
    """Writes it without the marks, as it was before there were some."""
    found = pq.read_table(table)
    at = found.schema.get_field_index("criteria")
    rows = found.column("criteria").to_pylist()
    for each in (finding for findings in rows for finding in findings):
        for figure in [each, *(each["figures"] or [])]:
            del figure["measures"]
    pq.write_table(found.set_column(at, "criteria", pa.array(rows)), table)


def nights(folder: Path, marks: list[str], without: int) -> dict[str, list[float | None]]:
    """Medians of nights that are published and read, the first `without` of a release before."""
    for number, mark in enumerate(marks):
        criteria = [finding(number + 1.0, mark)]
        rows = [make_row(f"a-{n:04d}", criteria=criteria, seconds=1.0) for n in range(3)]
        results = publish(folder, rows, uid=f"uid-{number}")
        manifest = json.loads((results / "manifest.json").read_text())
        manifest["provenance"]["ended"] = f"2026-10-{number + 1:02d}T04:00:00Z"
        (results / "manifest.json").write_text(json.dumps(manifest))
        if number < without:
            of_a_release_before(results / "results.parquet")
    ended = CliRunner().invoke(main, ["history", str(folder), "--output", "json"])
    assert ended.exception is None or isinstance(ended.exception, SystemExit), ended.exception
    return {each["name"]: each["median"] for each in json.loads(ended.output)["criteria"]}


def test_the_table_has_the_marks(tmp_path: Path) -> None:
    found = nights(tmp_path, ["a", "a", "b"], 0)
    assert found == {"goal": [None, None, 3.0], "goal (rad)": [None, None, 6.0]}


def test_tables_of_before_have_none(tmp_path: Path) -> None:
    found = nights(tmp_path, ["a", "a", "b"], 1)
    assert found == {"goal": [1.0, None, 3.0], "goal (rad)": [2.0, None, 6.0]}
