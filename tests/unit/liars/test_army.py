"""A row is judged by its own criterion, and its case has the name that the job gives it."""

from typing import Any

from bagpipe.plan.conditions import crossing
from bagpipe.spec import SimulationJobSpec
from tests.liars.army import cases_of, files_of, judged
from tests.liars.jobs import ERROR, LEAD_IN, LIVE, PROGRAM, STEPPED
from tests.liars.row import Row
from tests.liars.table import ROWS

ROW = Row("one", "time", "lies", ERROR, ("x",), "failed")


def case(reason: str, **found: str) -> dict[str, Any]:
    criteria = [
        {"name": name, "kind": "error", "outcome": outcome, "message": f"{name} it is"}
        for name, outcome in found.items()
    ]
    return {"outcome": "failed", "reason": reason, "message": "all", "criteria": criteria}


def test_other_criteria_than_the_row_s_say_nothing_of_it() -> None:
    result = judged(ROW, case("CriterionFailed", close="passed", fast="failed"), {"ran": 1})
    assert (result.outcome, result.reason) == ("passed", "")
    result = judged(ROW, case("CriterionFailed", close="invalid", fast="failed"), {"ran": 1})
    assert (result.outcome, result.reason) == ("invalid", "NotEnoughEvidence")
    assert "close it is" in result.words


def test_what_no_criterion_has_judged_stands() -> None:
    result = judged(ROW, case("StackCrashed", close="passed"), {})
    assert (result.outcome, result.reason, result.words) == ("failed", "StackCrashed", "all")
    result = judged(ROW, case("MessagesLost"), {})
    assert (result.outcome, result.reason) == ("failed", "MessagesLost")


def test_a_row_s_case_has_the_name_of_its_drive_fragment_and_scenario() -> None:
    other = Row("two", "time", "lies", LEAD_IN, ("x",), "failed")
    assert cases_of([ROW, other]) == ["drive-0000-s0", "warm-0001-s1"]
    assert cases_of([Row("three", "time", "lies", PROGRAM, ("x",), "failed")]) == ["number-s0"]
    assert files_of([ROW, other]) == ["drive.bag", "warm.bag"]


def test_every_job_of_the_table_is_a_valid_manifest() -> None:
    for job in {row.asked.job.name: row.asked.job for row in ROWS}.values():
        rows = [row for row in ROWS if row.asked.job.name == job.name]
        spec = job.spec(files_of(rows)) | {
            "stack": {"image": "any", "command": ["{{ row }}"], "engine": job.engine},
            "matrix": {"variables": {"row": [row.name for row in rows]}},
            "output": {"uri": "pvc://results/r"},
        }
        parsed = SimulationJobSpec.model_validate(spec)
        names = [conditions.values["row"] for _, conditions in crossing(parsed).named]
        assert names == [row.name for row in rows]
    assert LIVE.playback != STEPPED.playback
