"""Each criterion on recordings whose answer is known: passed, failed, and not enough evidence."""

import itertools
import math
import tracemalloc
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from pydantic import ValidationError

from bagpipe.evaluate import values
from bagpipe.evaluate.evidence import Evidence
from bagpipe.evaluate.finding import Finding, verdict
from bagpipe.evaluate.judge import evaluate, faults
from bagpipe.evaluate.model import Criterion
from bagpipe.evaluate.values import MOST_SECONDS
from tests.unit.evaluate.recordings import STORE, evidence, header, number, poses, stamped, text

ROOT = Path(__file__).parents[3]


def criterion(**measure: Any) -> Criterion:
    return Criterion.model_validate({"name": "c"} | measure)


def found(given: Evidence, **measure: Any) -> Finding:
    [finding] = evaluate([criterion(**measure)], given)
    return finding


def every(step: float, topic: str = "/out", first: float = 10.0, count: int = 10) -> list[Any]:
    return [(topic, first + n * step, number(float(n))) for n in range(count)]


@pytest.mark.parametrize(
    ("wanted", "outcome", "figure"),
    [
        ({}, "passed", 10.0),
        ({"min": 10}, "passed", 10.0),
        ({"min": 11}, "failed", 10.0),
        ({"min": 0, "max": 9}, "failed", 10.0),
        ({"topic": "/none"}, "failed", 0.0),
        ({"topic": "/none", "min": 0, "max": 9}, "passed", 0.0),
    ],
)
def test_presence(wanted: dict[str, Any], outcome: str, figure: float) -> None:
    finding = found(evidence(every(1.0)), presence={"topic": "/out"} | wanted)
    assert (finding.outcome, finding.figure, finding.unit) == (outcome, figure, "messages")


def test_the_lead_in_does_not_count() -> None:
    finding = found(evidence(every(1.0, first=5.0)), presence={"topic": "/out", "min": 6})
    assert (finding.outcome, finding.figure) == ("failed", 5.0)


@pytest.mark.parametrize(
    ("wanted", "outcome", "figure"),
    [
        ({"min": 0.9, "max": 1.1}, "passed", 1.0),
        ({"min": 1.01}, "failed", 1.0),
        ({"max": 0.99}, "failed", 1.0),
        ({"min": 1.0, "over": "worst"}, "failed", 1 / 3),
    ],
)
def test_rate(wanted: dict[str, Any], outcome: str, figure: float) -> None:
    entries = [*every(0.5, count=9), *every(1.0, first=17.0, count=1)]
    finding = found(evidence(entries), rate={"topic": "/out"} | wanted)
    assert finding.outcome == outcome
    assert finding.figure == pytest.approx(figure)


def test_a_silent_topic_has_a_rate_of_zero() -> None:
    finding = found(evidence(every(1.0)), rate={"topic": "/none", "min": 1})
    assert (finding.outcome, finding.figure) == ("failed", 0.0)
    assert finding.message == "0 Hz on /none, and may be at least 1 Hz"


def test_latency_is_from_stamp_to_receipt() -> None:
    entries = [("/pose", 10 + n + 0.01 * n, stamped(10.0 + n, 0, 0)) for n in range(10)]
    finding = found(evidence(entries), latency={"topic": "/pose", "max": "80ms"})
    assert (finding.outcome, finding.unit) == ("failed", "s")
    assert finding.figure == pytest.approx(0.09)
    finding = found(evidence(entries), latency={"topic": "/pose", "max": "50ms", "percentile": 50})
    assert finding.outcome == "passed"
    assert finding.figure == pytest.approx(0.04)


@pytest.mark.parametrize(
    ("entries", "sentence"),
    [
        ([("/pose", 10.0, number(1.0))], "have no header.stamp"),
        ([("/pose", 10.0, stamped(0.0, 0, 0))], "have an empty header.stamp"),
        ([], "no message on /pose was recorded; there is nothing"),
        ([("/pose", 9.0, stamped(9.0, 0, 0))], "no message on /pose was recorded in the case's"),
    ],
)
def test_latency_without_evidence_is_invalid(entries: list[Any], sentence: str) -> None:
    finding = found(evidence(entries), latency={"topic": "/pose", "max": "1s"})
    assert finding.outcome == "invalid"
    assert sentence in finding.message


@pytest.mark.parametrize(
    ("bounds", "outcome", "figure"),
    [
        ({"min": -5, "max": 9.5}, "passed", 9.0),
        ({"max": 8.5}, "failed", 9.0),
        ({"min": 0.5}, "failed", 0.0),
    ],
)
def test_bounds(bounds: dict[str, Any], outcome: str, figure: float) -> None:
    finding = found(evidence(every(1.0)), bounds={"topic": "/out", "field": "data"} | bounds)
    assert (finding.outcome, finding.figure) == (outcome, figure)


@pytest.mark.parametrize("sign", [1, -1])
@pytest.mark.parametrize(("over", "outcome"), [(0, "passed"), (1, "failed")])
def test_an_integer_is_held_against_its_bound_as_it_is(sign: int, over: int, outcome: str) -> None:
    """The next integer after 2^53 is no float."""
    kind = STORE.types["std_msgs/msg/Int64"]
    values = [2**53, 2**53 + over, 7]
    given = evidence([("/out", 10.0 + n, kind(sign * value)) for n, value in enumerate(values)])
    bound = {"max" if sign > 0 else "min": sign * 2.0**53}
    wanted = {"topic": "/out", "field": "data", "minCoverage": 0} | bound
    finding = found(given, bounds=wanted)
    assert (finding.outcome, finding.figure) == (outcome, sign * 2.0**53)
    assert isinstance(finding.figure, float)


@pytest.mark.parametrize("more", [0, 1, -1])
def test_an_integer_is_held_against_one_that_is_no_float(more: int) -> None:
    kind, bound = STORE.types["std_msgs/msg/UInt64"], 2**53 + 1
    given = evidence([("/out", 10.0 + n, kind(bound + more)) for n in range(10)])
    finding = found(given, bounds={"topic": "/out", "field": "data", "min": bound, "max": bound})
    assert finding.outcome == ("failed" if more else "passed")
    assert finding.limit == "9007199254740993 to 9007199254740993"
    assert finding.message.startswith(f"{bound + more} data of /out")
    over = {"topic": "/out", "field": "data", "max": 10**400}
    with pytest.raises(ValidationError, match="Input should be a valid number"):
        Criterion.model_validate({"name": "c", "bounds": over})


def scan(value: float) -> Any:
    """With the value in 32 bits, as a number and in an array."""
    ranges = np.array([0.0, value], dtype=np.float32)
    none = np.zeros(0, dtype=np.float32)
    kind = STORE.types["sensor_msgs/msg/LaserScan"]
    return kind(header(10), 0.0, 1.0, 0.1, 0.0, 0.1, 0.0, value, ranges, none)


@pytest.mark.parametrize("field", ["range_max", "ranges[1]"])
def test_a_number_of_32_bits_is_held_against_its_bound_in_32_bits(field: str) -> None:
    """What is clipped to 0.6 is 2.4e-8 more in these."""

    def judged(message: Any, path: str = field, **bounds: float) -> Finding:
        given = evidence([("/out", 10.0 + n, message) for n in range(10)])
        wanted = {"topic": "/out", "field": path, "minCoverage": 0}
        return found(given, bounds=wanted | bounds)

    for value in (0.6, -0.6, 0.3):
        assert judged(scan(value), min=-0.6, max=0.6).outcome == "passed", value
    assert judged(scan(0.6), min=-0.6, max=0.6).limit == "-0.6 to 0.6"
    for value in (0.6000001, -0.6000001):
        assert judged(scan(value), min=-0.6, max=0.6).outcome == "failed", value
    # No number of 32 bits is beyond them; and what has 64 bits is not rounded.
    assert judged(scan(0.6), max=1e300).outcome == "passed"
    assert judged(scan(0.0), min=1e-50).outcome == "failed"
    assert judged(number(0.6000000238418579), "data", max=0.6).outcome == "failed"


def test_of_messages_one_at_a_time_is_made_a_map_for_an_expression() -> None:
    """A map of 1,000 numbers is 32 kB, and all of them would be 6 MB."""
    ranges, none = np.arange(1000, dtype=np.float32), np.zeros(0, dtype=np.float32)
    kind = STORE.types["sensor_msgs/msg/LaserScan"]
    scans = [kind(header(at), 0.0, 1.0, 0.1, 0.0, 0.1, 0.0, 30.0, ranges, none)
             for at in (10 + n / 20 for n in range(200))]  # fmt: skip
    given = evidence([("/out", 10 + n / 20, each) for n, each in enumerate(scans)])
    assert len(given.recorded.samples("/out")) == 200
    wanted = {"topic": "/out", "holds": "msg.range_max > 1.0"}
    found(evidence([("/out", 10.0, scans[0])]), expression=wanted)  # which imports what it needs
    tracemalloc.start()
    finding = found(given, expression=wanted)
    _, most = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert finding.outcome == "passed"
    assert most < 2_000_000


def test_a_text_is_no_number_whatever_it_looks_like() -> None:
    given = evidence([("/out", 10.0 + n, text("0.3")) for n in range(10)])
    finding = found(given, bounds={"topic": "/out", "field": "data", "max": 1.0})
    assert (finding.outcome, finding.message) == ("invalid", "data is no number but str")


def test_a_nan_is_out_of_every_bound() -> None:
    entries = [("/out", 10.0, number(1.0)), ("/out", 12.5, number(math.nan))]
    finding = found(evidence(entries), bounds={"topic": "/out", "field": "data", "max": 2})
    assert finding.outcome == "failed"
    assert "at 2.500 s" in finding.message


@pytest.mark.parametrize(
    ("topic", "field", "sentence"),
    [
        ("/pose", "pose.position.q", "there is no q; there is x, y, z"),
        ("/pose", "pose", "pose is no number but geometry_msgs__msg__Pose"),
        ("/pose", "header.frame_id", "header.frame_id is no number but str"),
        ("/pose", "pose.position[0]", "position has no element 0"),
        ("/none", "data", "no message on /none was recorded; there is /pose"),
    ],
)
def test_a_field_that_is_not_there_is_invalid(topic: str, field: str, sentence: str) -> None:
    given = evidence([("/pose", 11.0, stamped(11.0, 1, 2))])
    finding = found(given, bounds={"topic": topic, "field": field, "max": 1})
    assert (finding.outcome, finding.figure) == ("invalid", None)
    assert sentence in finding.message


@pytest.mark.parametrize(
    ("holds", "share", "outcome", "figure"),
    [
        ("msg.data < 20.0", 1.0, "passed", 1.0),
        ("msg.data < 5.0", 1.0, "failed", 0.5),
        ("msg.data < 5.0", 0.5, "passed", 0.5),
        ("t < 3.5 || msg.data > case.speed", 1.0, "passed", 1.0),
    ],
)
def test_expressions(holds: str, share: float, outcome: str, figure: float) -> None:
    given = evidence(every(1.0), values={"speed": 3.5})
    finding = found(given, expression={"topic": "/out", "holds": holds, "share": share})
    assert (finding.outcome, finding.figure) == (outcome, figure)


@pytest.mark.parametrize("speed", [10, 10.0])
def test_a_variable_is_reckoned_with_as_the_page_says(speed: float) -> None:
    holds = "msg.data < double(case.speed) * 0.1"
    assert f"`{holds}`" in (ROOT / "docs/tasks/criteria.md").read_text()
    slower = [("/out", 10.0 + n, number(0.9)) for n in range(10)]
    given = evidence(slower, values={"speed": speed})
    wanted = {"topic": "/out", "holds": holds}
    assert found(given, expression=wanted).outcome == "passed"


def test_an_expression_says_where_it_first_failed() -> None:
    finding = found(evidence(every(1.0)), expression={"topic": "/out", "holds": "msg.data < 5.0"})
    assert finding.message == (
        "msg.data < 5.0 holds for 5 of 10 messages on /out, first not at 5.000 s"
    )


@pytest.mark.parametrize(
    ("holds", "sentence"),
    [
        ("msg.data <", "is no expression"),
        ("speed < 3", "names speed: write msg.<field>, t or case.<variable>"),
        ("msg.data", "and neither true nor false"),
        ("msg.nothing < 1.0", "can't be computed"),
        ("msg.data < 'x'", "can't be computed"),
    ],
)
def test_an_expression_that_can_t_be_evaluated_is_invalid(holds: str, sentence: str) -> None:
    finding = found(evidence(every(1.0)), expression={"topic": "/out", "holds": holds})
    assert finding.outcome == "invalid"
    assert sentence in finding.message


def test_an_expression_that_takes_too_long_is_given_up(monkeypatch: pytest.MonkeyPatch) -> None:
    each = itertools.count(0.0, MOST_SECONDS / 4)
    monkeypatch.setattr(values, "monotonic", lambda: next(each))
    finding = found(evidence(every(1.0)), expression={"topic": "/out", "holds": "msg.data < 5.0"})
    assert finding.outcome == "invalid"
    assert "took over 120 s for 4 of 10 messages: nest no macros" in finding.message
    # What has failed by then has failed, unless the rest may make up for it.
    for share, outcome in ((1.0, "failed"), (0.85, "failed"), (0.8, "invalid")):
        each = itertools.count(0.0, MOST_SECONDS / 4)
        monkeypatch.setattr(values, "monotonic", lambda each=each: next(each))
        limit = {"topic": "/out", "holds": "msg.data < 2.0", "share": share}
        finding = found(evidence(every(1.0)), expression=limit)
        assert (finding.outcome, share) == (outcome, share), finding.message
        assert finding.figure is None
        sentence = (
            "for 4 of 10 messages" if outcome == "invalid" else "holds for 2 of the first 4 of 10"
        )
        assert sentence in finding.message
        assert "took over 120 s" in finding.message


def test_expressions_are_looked_at_before_anything_runs() -> None:
    wrong = criterion(name="lane", expression={"topic": "/out", "holds": "speed < 3"})
    right = criterion(expression={"topic": "/out", "holds": "msg.data < 3.0"})
    [fault] = faults([right, wrong])
    assert fault.startswith("evaluate[lane]: speed < 3 names speed")


def course(offset: float, topic: str = "/pose", step: float = 1.0) -> list[Any]:
    return [(topic, 10 + n * step, stamped(10 + n * step, n * step, offset)) for n in range(9)]


@pytest.mark.parametrize(
    ("metric", "figure"), [("rmse", math.sqrt(0.11)), ("max", 0.6), ("final", 0.6)]
)
def test_error_against_a_truth(metric: str, figure: float) -> None:
    truth = course(0.0, "/truth")
    drift = [
        ("/pose", 10.0 + n, stamped(10.0 + n, n, 0.6 if n == 8 else 0.282842712)) for n in range(9)
    ]
    wanted = {
        "topic": "/pose",
        "truth": "/truth",
        "fields": ["pose.position.x", "pose.position.y"],
        "metric": metric,
        "max": 0.5,
    }
    finding = found(evidence([*truth, *drift]), error=wanted)
    assert finding.figure == pytest.approx(figure, abs=2e-3)
    assert finding.outcome == ("passed" if figure <= 0.5 else "failed")


def test_error_against_the_recording_s_own_output() -> None:
    given = evidence(course(0.25), source=course(0.0))
    wanted = {"topic": "/pose", "recording": True, "fields": ["pose.position.y"], "max": 0.25}
    finding = found(given, error=wanted)
    assert finding.outcome == "passed"
    assert finding.figure == pytest.approx(0.25)


def test_error_of_an_angle_goes_the_short_way() -> None:
    given = evidence(
        [("/a", 10.0 + n, number(3.1)) for n in range(3)]
        + [("/b", 10.0 + n, number(-3.1)) for n in range(3)]
    )
    wanted = {"topic": "/a", "truth": "/b", "fields": ["data"], "max": 0.1, "angle": True}
    assert found(given, error=wanted).figure == pytest.approx(math.tau - 6.2)


def test_a_truth_that_is_never_near_is_no_evidence() -> None:
    given = evidence([*course(0.0), *[("/truth", 10.5, stamped(10.5, 0, 0))]])
    wanted = {"topic": "/pose", "truth": "/truth", "fields": ["pose.position.y"], "max": 9}
    finding = found(given, error=wanted)
    assert finding.outcome == "invalid"
    assert "0 of 9 messages on /pose have a truth within 50ms" in finding.message


@pytest.mark.parametrize(
    ("wanted", "outcome"),
    [
        ({"position": [8, 1], "maxDistance": 0.1}, "passed"),
        ({"position": [8, 1, 0], "maxDistance": 0.1}, "passed"),
        ({"position": [8, 1, 0.2], "maxDistance": 0.1}, "failed"),
        ({"position": [8, 2], "maxDistance": 0.9}, "failed"),
        ({"position": [8, 1], "maxDistance": 0.1, "yaw": 0, "maxYawError": 0.1}, "passed"),
        ({"position": [8, 1], "maxDistance": 0.1, "yaw": 3.14, "maxYawError": 0.1}, "failed"),
    ],
)
def test_the_final_pose(wanted: dict[str, Any], outcome: str) -> None:
    given = evidence(course(1.0), end=18.5)
    finding = found(given, finalPose={"topic": "/pose"} | wanted)
    assert finding.outcome == outcome
    units = ["m", "rad"] if "yaw" in wanted else []
    assert [each.unit for each in finding.figures] == units


def test_a_type_without_a_pose_is_no_evidence() -> None:
    finding = found(
        evidence(every(1.0)), finalPose={"topic": "/out", "position": [0, 0], "maxDistance": 1}
    )
    assert finding.outcome == "invalid"


def drive(obstacle_speed: float) -> list[Any]:
    """The ego car at 10 m/s; an obstacle 60 m ahead in its lane."""
    entries = []
    for n in range(41):
        t = 10 + n * 0.1
        entries.append(("/ego", t, stamped(t, n * 1.0, 0.0)))
        entries.append(("/obstacles", t, poses(t, (60 + n * obstacle_speed / 10, 0.0))))
    return entries


@pytest.mark.parametrize(
    ("speed", "wanted", "outcome", "figure"),
    [
        (0.0, {"minDistance": 10}, "passed", 20.0),
        (0.0, {"minDistance": 21}, "failed", 20.0),
        (0.0, {"minTimeToCollision": 1.5}, "passed", 1.7),
        (0.0, {"minTimeToCollision": 2.0}, "failed", 1.7),
        (10.0, {"minTimeToCollision": 100}, "passed", math.inf),
    ],
)
def test_separation(speed: float, wanted: dict[str, Any], outcome: str, figure: float) -> None:
    given = evidence(drive(speed), end=14.5)
    finding = found(given, separation={"ego": "/ego", "obstacles": "/obstacles"} | wanted)
    assert finding.figure == pytest.approx(figure)
    assert finding.outcome == outcome


def test_a_scene_without_obstacles_proves_nothing() -> None:
    entries = [("/ego", 10.0, stamped(10.0, 0, 0)), ("/obstacles", 10.0, poses(10.0))]
    wanted = {"ego": "/ego", "obstacles": "/obstacles", "minDistance": 1}
    assert found(evidence(entries), separation=wanted).outcome == "invalid"


USAGE = {"stack": {"usage": {"seconds": 10.0, "cpu_seconds": 4.0, "peak_memory_bytes": 3 << 20}}}


@pytest.mark.parametrize(
    ("wanted", "outcome", "figure"),
    [
        ({"maxCpu": 0.5}, "passed", 0.4),
        ({"maxCpu": 0.3}, "failed", 0.4),
        ({"maxMemory": "4Mi"}, "passed", float(3 << 20)),
        ({"maxMemory": "3M", "maxCpu": 1}, "failed", float(3 << 20)),
    ],
)
def test_resources(wanted: dict[str, Any], outcome: str, figure: float) -> None:
    finding = found(evidence([], result=USAGE), resources=wanted)
    assert (finding.outcome, finding.figure) == (outcome, figure)


def test_resources_that_were_not_measured_are_no_evidence() -> None:
    assert found(evidence([]), resources={"maxCpu": 1}).outcome == "invalid"
    assert found(evidence([]), resources={"maxMemory": "1G"}).outcome == "invalid"


# Promise: expected-failure
def test_an_expected_failure_passes_and_a_pass_is_news() -> None:
    given = evidence(every(1.0))
    failed = found(given, expectFailure=True, presence={"topic": "/out", "min": 11})
    assert (failed.outcome, failed.expected_failure) == ("passed", True)
    passed = found(given, expectFailure=True, presence={"topic": "/out"})
    assert (passed.outcome, passed.expected_failure) == ("failed", True)
    doubt = found(given, expectFailure=True, latency={"topic": "/out", "max": "1s"})
    assert doubt.outcome == "invalid"


def test_a_damaged_recording_is_no_evidence() -> None:
    given = evidence([("/out", 11.0, text("x"))])
    given.recorded._read = lambda: b"#ROSBAG V2.0\nnothing"
    finding = found(given, bounds={"topic": "/out", "field": "data", "max": 1})
    assert finding.outcome == "invalid"


def test_a_failure_outweighs_a_doubt_and_a_doubt_a_pass() -> None:
    passed, failed, doubt = (
        Finding("a", "rate", "passed"),
        Finding("b", "rate", "failed", message="too slow"),
        Finding("c", "rate", "invalid", message="not measured"),
    )
    assert verdict([passed]) == ("passed", "", "")
    assert verdict([passed, doubt, failed]) == ("failed", "CriterionFailed", "b: too slow")
    assert verdict([passed, doubt]) == ("invalid", "NotEnoughEvidence", "c: not measured")


@pytest.mark.parametrize(
    ("measure", "sentence"),
    [
        ({}, "no measurement"),
        ({"presence": {"topic": "/a"}, "rate": {"topic": "/a", "min": 1}}, "presence and rate"),
        ({"rate": {"topic": "/a"}}, "neither min nor max"),
        ({"rate": {"topic": "a", "min": 1}}, "begin with a slash"),
        ({"rate": {"topic": "/a", "min": 2, "max": 1}}, "is below min"),
        ({"bounds": {"topic": "/a", "field": "a..b", "max": 1}}, "is no field"),
        ({"bounds": {"topic": "/a", "field": "a", "max": math.inf}}, "finite"),
        ({"latency": {"topic": "/a", "max": "3"}}, "not a duration"),
        ({"error": {"topic": "/a", "fields": ["x"], "max": 1}}, "no truth is named"),
        ({"separation": {"ego": "/a", "obstacles": "/b"}}, "write minDistance"),
        ({"resources": {}}, "write maxCpu or maxMemory"),
        ({"presence": {"topic": "/a", "least": 3}}, "Extra inputs"),
        ({"own": {"configMap": "a", "file": "../x.py"}}, "should match pattern"),
    ],
)
def test_a_criterion_that_can_t_be_meant_is_refused(measure: dict[str, Any], sentence: str) -> None:
    with pytest.raises(ValidationError) as refused:
        criterion(**measure)
    assert sentence in str(refused.value)
