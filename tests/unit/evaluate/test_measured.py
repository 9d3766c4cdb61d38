"""Figures can be compared where criteria measure the same, whatever they demand of it."""

from typing import Any

import pytest

from bagpipe.evaluate.judge import evaluate
from bagpipe.evaluate.measured import earlier_mark_of, mark_of
from bagpipe.evaluate.model import Criterion
from bagpipe.row_facts import SLOWED
from tests.unit.crds.test_criteria_refusals import GOOD
from tests.unit.evaluate.recordings import evidence, stamped

Value = dict[str, Any]


def mark(
    kind: str, changed: Value | None = None, rate: float = 1.0, name: str = "c", unit: str = "m"
) -> str:
    given = {"name": name, kind: GOOD[kind] | (changed or {})}
    return mark_of(Criterion.model_validate(given), unit, rate)


@pytest.mark.parametrize(
    ("kind", "changed"),
    [
        ("presence", {"min": 1, "max": 9, "minCoverage": 0.9}),
        ("rate", {"min": 2, "max": 3, "minCoverage": 0.1}),
        ("latency", {"max": "2s", "minCoverage": 0.1}),
        ("bounds", {"min": 0, "max": 7}),
        ("expression", {"share": 0.9}),
        ("error", {"max": 7, "stampTolerance": "0.05s"}),
        ("error", {"anyFrame": False}),
        ("finalPose", {"maxDistance": 3, "maxYawError": 0.5}),
        ("separation", {"minDistance": 4, "minTimeToCollision": 2, "maxAge": "0.5s"}),
        ("separation", {"anyFrame": True}),
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
    ],
)
def test_what_is_measured_otherwise_has_another_mark(kind: str, changed: Value) -> None:
    assert mark(kind, changed) != mark(kind)


@pytest.mark.parametrize(
    ("kind", "changed", "other", "same"),
    [
        ("finalPose", {"yaw": 1.0}, "rad", "m"),
        ("finalPose", {"position": [1, 2]}, "m", "rad"),
        ("separation", {"radius": 2}, "s", "m"),
    ],
)
def test_a_figure_is_another_one_by_what_it_depends_on(
    kind: str, changed: Value, other: str, same: str
) -> None:
    assert mark(kind, changed, unit=other) != mark(kind, unit=other)
    assert mark(kind, changed, unit=same) == mark(kind, unit=same)


def test_a_heading_that_is_asked_for_as_well_leaves_the_distance_what_it_was() -> None:
    given = {k: v for k, v in GOOD["finalPose"].items() if k not in {"yaw", "maxYawError"}}
    without = Criterion.model_validate({"name": "c", "finalPose": given})
    assert mark_of(without, "m", 1.0) == mark("finalPose")


def test_what_is_so_without_a_word_makes_a_figure_no_other_one_where_it_is_written() -> None:
    topic, fields = GOOD["error"]["topic"], GOOD["error"]["fields"]
    recorded: Value = {"truth": None, "recording": True}
    assert mark("error", recorded | {"truth": topic}) == mark("error", recorded)
    assert mark("error", {"truthFields": fields}) == mark("error", {"truthFields": []})
    for other in ({"truth": "/other", "recording": True}, {"truthFields": ["u"] * len(fields)}):
        assert mark("error", other) not in {mark("error"), mark("error", recorded)}


def test_a_latency_is_compared_with_one_of_a_play_as_slow_or_as_fast() -> None:
    """In a fast play it is in bag time, of which a stack takes `rate` times as much."""
    rates = (0.1, 0.5, 1.0, 2.0, 4.0)
    marks = [mark("latency", rate=rate) for rate in rates]
    assert len(set(marks)) == len(rates)
    assert [each.startswith(SLOWED) for each in marks] == [True, True, False, False, False]
    for kind in GOOD.keys() - {"latency"}:
        assert len({mark(kind, rate=rate) for rate in rates}) == 1


def test_cpu_seconds_of_a_second_on_the_wall_are_compared_at_one_rate() -> None:
    rates = (0.25, 1.0, 4.0)
    assert len({mark("resources", rate=rate, unit="CPUs") for rate in rates}) == len(rates)
    assert len({mark("resources", rate=rate, unit="bytes") for rate in rates}) == 1
    criterion = Criterion.model_validate({"name": "c", "resources": {"maxCpu": 1.5}})
    unpaced = mark_of(criterion, "CPUs", 1.0, paced=False)
    assert unpaced not in {mark_of(criterion, "CPUs", rate) for rate in rates}
    # Releases before measured the same; lock-step has no rate, and is taken for real time.
    assert earlier_mark_of(criterion, "CPUs", "max", 1.0) == unpaced
    assert earlier_mark_of(criterion, "CPUs", "realtime", 4.0) == mark_of(criterion, "CPUs", 4.0)
    assert earlier_mark_of(criterion, "CPUs", "lockstep", 4.0) == mark_of(criterion, "CPUs", 1.0)


def test_the_worst_gap_by_receipt_is_another_figure_than_by_stamps() -> None:
    """Every tenth second a message, of which those from 14 to 15 s come 0.85 s late."""
    came = [10 + n / 10 for n in range(100)]
    late = [("/p", at + (0.9 if 14 < at < 15 else 0.05), stamped(at, 1.0, 0.0)) for at in came]
    worst = Criterion.model_validate(
        {"name": "c", "rate": {"topic": "/p", "min": 0.5, "over": "worst"}}
    )
    [by_receipt] = evaluate([worst], evidence(late))
    [by_stamp] = evaluate([worst], evidence(late, paced=False))
    assert by_receipt.figure != by_stamp.figure
    assert by_receipt.measures == mark_of(worst, "Hz", 1.0)
    assert by_stamp.measures == mark_of(worst, "Hz", 1.0, paced=False) != by_receipt.measures
    # Releases before went by receipt in every mode, of which bag time in max says nothing.
    earlier = {mode: earlier_mark_of(worst, "Hz", mode, 2.0) for mode in ("lockstep", "max")}
    assert earlier["lockstep"] == by_receipt.measures
    assert earlier["max"] not in {by_receipt.measures, by_stamp.measures}
    over_all = Criterion.model_validate({"name": "c", "rate": {"topic": "/p", "min": 0.5}})
    assert mark_of(over_all, "Hz", 1.0, paced=False) == mark_of(over_all, "Hz", 1.0)


def test_what_a_user_s_own_evaluator_measures_is_not_known() -> None:
    assert mark("own") == ""


def test_every_finding_has_its_criterion_s_mark() -> None:
    given = [{"name": kind, kind: GOOD[kind], "expectFailure": kind == "rate"} for kind in GOOD]
    criteria = [Criterion.model_validate(each) for each in given if "own" not in each]
    rows = [finding.as_row() for finding in evaluate(criteria, evidence([]))]
    marks = [mark_of(each, "", 1.0) for each in criteria]
    # Presence and rate judge silence; the others have no figure of it, nor a unit.
    assert [row["measures"] for row in rows] == marks
    assert len(set(marks)) == 9


def test_each_of_several_figures_has_its_mark() -> None:
    wanted = {"position": [3, 0], "maxDistance": 1, "yaw": 0, "maxYawError": 0.1}
    criterion = Criterion.model_validate({"name": "c", "finalPose": {"topic": "/t"} | wanted})
    [finding] = evaluate([criterion], evidence([("/t", 19.9, stamped(19.9, 3.0, 0.0))]))
    marks = [mark_of(criterion, unit, 1.0) for unit in ("m", "rad")]
    assert [each["measures"] for each in finding.as_row()["figures"]] == marks
    assert finding.measures == marks[0] != marks[1]
