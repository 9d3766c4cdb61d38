"""Figures of releases that wrote no marks, by the job that lies beside them."""

import json
from pathlib import Path
from typing import Any

import pytest

from bagpipe.cli.compare import compared
from bagpipe.compare.compare import Comparison, compare
from bagpipe.driver.baseline import baseline_rows
from bagpipe.evaluate.measured import mark_of
from bagpipe.evaluate.model import Criterion
from bagpipe.report.stored import StoredResults
from bagpipe.storage import Storage
from tests.unit.compare.rows import row
from tests.unit.report.publishing import stored

Value = dict[str, Any]
RECORDINGS = 12
SPEC: Value = {
    "source": {"bags": ["pvc://r/*.mcap"], "topics": ["/scan"], "fragment": {"length": "10s"}},
    "stack": {"image": "a/b:1", "command": ["x"]},
    "record": {"topics": ["/pose"]},
    "output": {"uri": "pvc://r/out"},
}
NOT_COMPARED = "not compared, as something else is measured now: latency"


def asked(**more: Any) -> Value:
    return {"name": "latency", "latency": {"topic": "/pose", "max": "1s", **more}}


def rows(figure: float, mark: str | None = None) -> list[Value]:
    made = [row(n, "", figure=figure + 0.001 * n) for n in range(RECORDINGS)]
    added = {"kind": "latency"} | ({} if mark is None else {"measures": mark})
    return [each | {"criteria": [each["criteria"][0] | added]} for each in made]


def results(folder: Path, made: list[Value], spec: Any = None) -> StoredResults:
    folder.mkdir(exist_ok=True)
    stored(folder, "".join(json.dumps(each) + "\n" for each in made), len(made))
    if spec is not None:
        (folder / "job.json").write_text(json.dumps({"spec": spec}))
    return StoredResults(folder.as_uri(), Storage({}))


def now(figure: float, rate: float = 1.0, **more: Any) -> list[Value]:
    return rows(figure, mark_of(Criterion.model_validate(asked(**more)), "s", rate))


def against(folder: Path, later: list[Value], spec: Any) -> Comparison:
    earlier = results(folder, rows(0.4), spec)
    [found] = compare(later, [], baseline_rows(earlier.uri, earlier.storage))
    return found


def test_another_definition_is_not_compared_with_a_baseline_without_marks(tmp_path: Path) -> None:
    found = against(tmp_path, now(0.2, percentile=50), {"evaluate": [asked()]})
    assert (found.verdict, found.message.endswith(NOT_COMPARED)) == ("same", True)
    assert against(tmp_path, now(0.2), {"evaluate": [asked(max="2s")]}).verdict == "better"


@pytest.mark.parametrize(
    "spec",
    [
        None,
        {"evaluate": 7},
        {"evaluate": [7, asked(percentile="50")]},
        {"evaluate": [asked(within="1s")], "playback": 7},
        {"evaluate": [{"name": "latency", "own": {"configMap": "a"}}]},
        {"evaluate": [asked() | {"name": "other"}]},
        {"evaluate": [asked(percentile=50)], "playback": {"rate": "fast"}},
        {"evaluate": [asked(percentile=50)], "playback": {"rate": 10**400}},
    ],
)
def test_what_is_not_known_of_a_baseline_hinders_no_comparison(tmp_path: Path, spec: Any) -> None:
    assert against(tmp_path, now(0.2), spec).verdict == "better"


def test_a_job_of_other_fields_has_the_marks_of_what_is_as_today(tmp_path: Path) -> None:
    spec = {
        "evaluate": [
            {"name": "e", "error": {"topic": "/a", "within": "1s"}},
            asked(percentile=50),
        ],
        "playback": {"repeat": 3, "rate": 1},
    }
    assert against(tmp_path, now(0.2), spec).message.endswith(NOT_COMPARED)
    assert against(tmp_path, now(0.2, percentile=50), spec).verdict == "better"


@pytest.mark.parametrize(
    ("playback", "rate", "verdict"),
    [
        ({"rate": 4}, 4.0, "better"),
        ({"rate": 4}, 1.0, "same"),
        # In bag time, which no latency of a slow play is in any more.
        ({"rate": 0.5}, 0.5, "same"),
        ({"rate": 0.5}, 1.0, "same"),
        # It had the time of an input, however fast that was to be.
        ({"mode": "max"}, 1.0, "same"),
        ({"mode": "lockstep", "rate": 4}, 4.0, "same"),
    ],
)
def test_a_latency_without_a_mark_is_that_of_its_play(
    tmp_path: Path, playback: Value, rate: float, verdict: str
) -> None:
    spec = {"evaluate": [asked()], "playback": playback}
    found = against(tmp_path, now(0.2, rate), spec)
    assert (found.verdict, found.message.endswith(NOT_COMPARED)) == (verdict, verdict == "same")


@pytest.mark.parametrize("playback", [{"rate": 0.5}, {"rate": 4}, {"mode": "max"}])
def test_two_results_without_marks_are_compared_by_their_jobs(
    tmp_path: Path, playback: Value
) -> None:
    spec = {"playback": playback}
    before = results(tmp_path / "a", rows(0.4), spec | {"evaluate": [asked()]})
    same = results(tmp_path / "b", rows(0.2), SPEC | spec | {"evaluate": [asked()]})
    other = results(tmp_path / "c", rows(0.2), SPEC | spec | {"evaluate": [asked(percentile=50)]})
    assert [each["verdict"] for each in compared(before, same)] == ["better"]
    assert [each["message"].endswith(NOT_COMPARED) for each in compared(before, other)] == [True]


def test_marks_that_are_there_stay(tmp_path: Path) -> None:
    there = results(tmp_path, rows(0.4, "known"), {"evaluate": [asked()]})
    kept = [each["criteria"][0]["measures"] for each in there.baseline_rows()]
    assert kept == ["known"] * RECORDINGS


def test_each_of_several_figures_has_its_mark(tmp_path: Path) -> None:
    goal = {"topic": "/pose", "position": [1, 2], "maxDistance": 1, "yaw": 1, "maxYawError": 1}
    given = {"name": "goal", "finalPose": goal}
    figures = [{"figure": 1.0, "unit": unit, "direction": "lower"} for unit in ("m", "rad")]
    finding = {"name": "goal", "kind": "finalPose", "figures": figures} | figures[0]
    there = results(tmp_path, [row(0, "") | {"criteria": [finding]}], {"evaluate": [given]})
    [found] = there.baseline_rows()
    [marked] = found["criteria"]
    criterion = Criterion.model_validate(given)
    marks = [mark_of(criterion, unit, 1.0) for unit in ("m", "rad")]
    assert [each["measures"] for each in marked["figures"]] == marks
    assert marked["measures"] == marks[0]
