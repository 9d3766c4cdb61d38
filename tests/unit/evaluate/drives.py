"""Cases for tests of criteria: windows from 10 to 15 s, with 50 inputs at 10 Hz."""

from typing import Any

from bagpipe.evaluate.evidence import Evidence
from bagpipe.evaluate.finding import Finding
from bagpipe.evaluate.judge import evaluate
from bagpipe.evaluate.model import Criterion
from tests.unit.evaluate.recordings import evidence, number, poses, stamped

INPUTS = [10 + n / 10 for n in range(50)]
LATENCY = {"latency": {"topic": "/pose", "max": "80ms"}}
RATE = {"rate": {"topic": "/pose", "min": 9.5}}
PRESENCE = {"presence": {"topic": "/pose", "min": 50}}
BOUNDS = {"bounds": {"topic": "/pose", "field": "pose.position.x", "min": -1, "max": 100}}
HOLDS = {"expression": {"topic": "/pose", "holds": "!(msg.pose.position.x > 100.0)"}}
ERROR = {
    "error": {
        "topic": "/pose",
        "truth": "/truth",
        "recording": True,
        "fields": ["pose.position.x", "pose.position.y"],
        "metric": "max",
        "max": 0.5,
    }
}
GOAL = {
    "finalPose": {
        "topic": "/pose",
        "position": [14.9, 0.0],
        "maxDistance": 0.2,
        "yaw": 0.0,
        "maxYawError": 0.1,
    }
}
KEEPS_AWAY = {"separation": {"ego": "/pose", "obstacles": "/cars", "minDistance": 2}}
DAY = 86_400.0


def answer(at: float, late: float = 0.01, **more: Any) -> Any:
    """A right answer to the input at `at`."""
    stamp = more.get("stamp", at)
    return ("/pose", at + late, stamped(stamp, more.get("x", at), more.get("y", 0.0)))


def unstamped(times: list[float]) -> list[Any]:
    return [("/pose", at, number(1.0)) for at in times]


RIGHT = [answer(at) for at in INPUTS]
CARS = [("/cars", at, poses(at, (at, 10.0))) for at in INPUTS]


def case(recorded: list[Any], **more: Any) -> Evidence:
    truth = [("/truth", at, stamped(at, at, 0.0)) for at in INPUTS]
    return evidence(recorded, more.pop("truth", truth), end=15.0, **more)


def found(given: Evidence, measure: dict[str, Any], **more: Any) -> Finding:
    [finding] = evaluate([Criterion.model_validate({"name": "c"} | measure | more)], given)
    return finding


def less(measure: dict[str, Any], share: float) -> dict[str, Any]:
    return {kind: fields | {"minCoverage": share} for kind, fields in measure.items()}


ALL = [LATENCY, RATE, PRESENCE, BOUNDS, HOLDS, ERROR, GOAL, KEEPS_AWAY]
ANSWERED = [LATENCY, BOUNDS, HOLDS, ERROR, GOAL, KEEPS_AWAY]


def named(value: object) -> str | None:
    """A measure's test is called by its kind."""
    return str(next(iter(value))) if isinstance(value, dict) else None
