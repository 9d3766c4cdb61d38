"""Figures can be compared where criteria measure the same, whatever they demand of it."""

from typing import Any

import pytest

from bagpipe.evaluate.judge import evaluate
from bagpipe.evaluate.measured import mark_of
from bagpipe.evaluate.model import Criterion
from tests.unit.crds.test_criteria_refusals import GOOD
from tests.unit.evaluate.recordings import evidence

Value = dict[str, Any]


def mark(kind: str, changed: Value | None = None, rate: float = 1.0, name: str = "c") -> str:
    given = {"name": name, kind: GOOD[kind] | (changed or {})}
    return mark_of(Criterion.model_validate(given), rate)


@pytest.mark.parametrize(
    ("kind", "changed"),
    [
        ("presence", {"min": 1, "max": 9, "minCoverage": 0.9}),
        ("rate", {"min": 2, "max": 3, "minCoverage": 0.1}),
        ("latency", {"max": "2s", "minCoverage": 0.1}),
        ("bounds", {"min": 0, "max": 7}),
        ("expression", {"share": 0.9}),
        ("error", {"max": 7, "stampTolerance": "0.05s"}),
        ("finalPose", {"maxDistance": 3, "maxYawError": 0.5}),
        ("separation", {"minDistance": 4, "minTimeToCollision": 2, "maxAge": "0.5s"}),
        ("resources", {"maxCpu": 3, "maxMemory": "1Gi"}),
    ],
)
def test_what_is_demanded_of_a_figure_makes_it_no_other_one(kind: str, changed: Value) -> None:
    assert mark(kind, changed, name="d") == mark(kind) != ""


@pytest.mark.parametrize(
    ("kind", "changed"),
    [
        ("presence", {"topic": "/b"}),
        ("rate", {"over": "window"}),
        ("latency", {"percentile": 90}),
        ("bounds", {"field": "x"}),
        ("expression", {"holds": "msg.data < 2.0"}),
        ("expression", {"finite": True}),
        ("error", {"metric": "max"}),
        ("error", {"truth": "/c"}),
        ("error", {"stampTolerance": "60ms"}),
        ("error", {"angle": False}),
        ("finalPose", {"position": [1, 2]}),
        ("separation", {"radius": 2}),
    ],
)
def test_what_is_measured_otherwise_has_another_mark(kind: str, changed: Value) -> None:
    assert mark(kind, changed) != mark(kind)


def test_a_latency_of_a_slow_play_is_compared_with_one_as_slow() -> None:
    assert mark("latency", rate=0.5) not in {mark("latency"), mark("latency", rate=0.1)}
    assert mark("latency", rate=2.0) == mark("latency")
    assert mark("rate", rate=0.5) == mark("rate")


def test_what_a_user_s_own_evaluator_measures_is_not_known() -> None:
    assert mark("own") == ""


def test_every_finding_has_its_criterion_s_mark() -> None:
    given = [{"name": kind, kind: GOOD[kind], "expectFailure": kind == "rate"} for kind in GOOD]
    criteria = [Criterion.model_validate(each) for each in given if "own" not in each]
    rows = [finding.as_row() for finding in evaluate(criteria, evidence([]))]
    assert [row["measures"] for row in rows] == [mark_of(each, 1.0) for each in criteria]
    assert len({row["measures"] for row in rows}) == 9
