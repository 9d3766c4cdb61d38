"""Jobs for tests: valid defaults, changed where a test says so."""

from typing import Any

from bagpipe.run.case_run import Row
from bagpipe.spec import JobFile, SimulationJobSpec
from tests.unit.bagpipe.fake_agent import RESULT


def make_spec(**changed: Any) -> SimulationJobSpec:
    """A spec with the given top-level fields replaced."""
    fields: dict[str, Any] = {
        "source": {"bags": ["pvc://recordings/*.bag"], "topics": ["/scan"]},
        "stack": {"image": "stack:1", "command": ["run"]},
        "record": {"topics": ["/out"]},
        "output": {"uri": "pvc://results/out"},
    }
    return SimulationJobSpec.model_validate(fields | changed)


def make_job(volumes: dict[str, str], **changed: Any) -> JobFile:
    """A job file around `make_spec(**changed)`."""
    return JobFile(
        name="drive",
        namespace="lab",
        uid="uid-1",
        attempt=1,
        spec=make_spec(**changed),
        images={"spark": "spark:1", "agent": "agent:1"},  # type: ignore[arg-type]
        volumes=volumes,
    )


def make_row(case: str, outcome: str = "passed", reason: str = "", **changed: Any) -> Row:
    """The row of a case that ended; what else differs from the usual is given by name."""
    made: Row = {
        "case": case,
        "fragment": "",
        "variant": "",
        "scenario": None,
        "values": {},
        "seed": 0,
        "round": 0,
        "bag": "pvc://recordings/a.bag",
        "outcome": outcome,
        "reason": reason,
        "message": f"why {case}" if reason else "",
        "recorded": f"cases/{case}.bag" if outcome == "passed" else None,
        "result": RESULT if outcome == "passed" else None,
        "attempts": 1,
    }
    return made | changed
