"""The courses of criteria over time: which points, and how many."""

import itertools
import json
import math
from typing import Any

import pytest

from bagpipe.evaluate import courses, plane, values
from bagpipe.evaluate.courses import (
    MOST_PASSED_POINTS,
    MOST_PASSED_POINTS_OF_ALL,
    MOST_POINTS,
    MOST_POINTS_OF_ALL,
    thinned,
)
from bagpipe.evaluate.judge import evaluate
from bagpipe.evaluate.model import Criterion
from bagpipe.moments import moment_of
from tests.unit.evaluate.recordings import evidence, number, poses, stamped

RECORDED = [
    ("/v", 9.5, number(99.0)),
    ("/v", 10.5, number(5.0)),
    ("/v", 11.5, number(6.0)),
    ("/v", 12.0, number(7.0)),
    ("/p", 11.0, stamped(10.75, 3.0, 4.0)),
    ("/p", 12.0, stamped(11.5, 6.0, 8.0)),
    ("/o", 11.5, poses(11.2, (3.0, 5.0), (9.0, 9.0))),
]
UNITS = {
    "bounds": "",
    "rate": "Hz",
    "latency": "s",
    "finalPose": "m",
    "error": "",
    "separation": "m",
    "presence": "messages",
    "expression": "",
}
SOURCE = [("/p", 11.0, stamped(10.75, 1.0, 4.0)), ("/p", 12.0, stamped(11.5, 1.0, 8.0))]


@pytest.mark.parametrize(
    ("kind", "fields", "label", "low", "high", "points"),
    [
        (
            "bounds", {"topic": "/v", "field": "data", "max": 2.0}, "/v data", None, 2.0,
            [[0.5, 5.0], [1.5, 6.0], [2.0, 7.0]],
        ),
        (
            "rate", {"topic": "/v", "min": 9}, "/v, 1 / time since the last", 9.0, None,
            [[1.5, 1.0], [2.0, 2.0]],
        ),
        (
            "latency", {"topic": "/p", "max": "100ms", "minCoverage": 0},
            "/p, stamp to receipt", None, 0.1,
            [[1.0, 0.25], [2.0, 0.5]],
        ),
        (
            "finalPose", {"topic": "/p", "position": [0, 0], "maxDistance": 1, "minCoverage": 0.5},
            "/p, distance from the goal", None, 1.0, [[1.0, 5.0], [2.0, 10.0]],
        ),
        (
            "error", {"topic": "/p", "fields": ["pose.position.x"], "recording": True, "max": 1,
                      "minCoverage": 0.5},
            "/p pose.position.x off the truth", None, 1.0, [[1.0, 2.0], [2.0, 5.0]],
        ),
        (
            "separation", {"ego": "/p", "obstacles": "/o", "minDistance": 3},
            "/p, distance to the nearest of /o", 3.0, None, [[1.2, 2.2804]],
        ),
        (
            "presence", {"topic": "/v", "min": 9}, "/v, messages so far", 9, None,
            [[0.0, 0.0], [0.5, 1.0], [1.5, 2.0], [2.0, 3.0], [2.5, 3.0]],
        ),
        (
            "expression", {"topic": "/v", "holds": "msg.data < 6.5"},
            "msg.data < 6.5: 1 where it holds", 1.0, None,
            [[0.5, 1.0], [1.5, 1.0], [2.0, 0.0]],
        ),
    ],
)  # fmt: skip
def test_a_failing_criterion_has_a_course(
    kind: str,
    fields: dict[str, Any],
    label: str,
    low: float | None,
    high: float | None,
    points: list[list[float]],
) -> None:
    [found] = evaluate([criterion(kind, fields)], evidence(RECORDED, SOURCE, end=12.5))
    assert found.outcome == "failed"
    course = found.as_row()["course"]
    assert (course["label"], course["low"], course["high"]) == (label, low, high)
    assert course["unit"] == UNITS[kind]
    assert course["points"] == points


def criterion(kind: str, fields: dict[str, Any]) -> Criterion:
    return Criterion.model_validate({"name": "c", kind: fields})


def test_what_passes_and_what_lacks_evidence_has_one_too() -> None:
    wide = criterion("bounds", {"topic": "/v", "field": "data", "max": 100, "minCoverage": 0})
    whole = criterion("bounds", {"topic": "/v", "field": "data", "max": 100})
    passed, invalid = evaluate([wide, whole], evidence(RECORDED))
    assert (passed.outcome, invalid.outcome) == ("passed", "invalid")
    assert passed.course == invalid.course
    assert passed.course is not None
    assert passed.course["points"] == [[0.5, 5.0], [1.5, 6.0], [2.0, 7.0]]


def test_what_is_not_there_or_has_no_time_has_none() -> None:
    wanted = [
        criterion("bounds", {"topic": "/none", "field": "data", "max": 100}),
        criterion("resources", {"maxCpu": 1.0}),
    ]
    usage = {"stack": {"usage": {"seconds": 9.0, "cpu_seconds": 99.0}}}
    found = evaluate(wanted, evidence(RECORDED, result=usage))
    assert [each.outcome for each in found] == ["invalid", "failed"]
    assert ["course" in each.as_row() for each in found] == [False, False]


def test_no_message_at_all_is_a_course_that_stays_at_zero() -> None:
    made = course("presence", {"topic": "/none"}, RECORDED)
    assert made["points"] == [[0.0, 0.0], [10.0, 0.0]]


@pytest.mark.parametrize(("share", "low"), [(1.0, 1.0), (0.9, None)])
def test_a_share_of_messages_has_no_line_that_each_must_keep(
    share: float, low: float | None
) -> None:
    fields = {"topic": "/v", "holds": "msg.data < 6.5", "share": share, "minCoverage": 0}
    made = course("expression", fields, RECORDED)
    assert (made["low"], made["step"]) == (low, True)


def test_values_that_are_no_number_are_times_at_which_there_is_none() -> None:
    recorded = [("/v", 10.0 + n, number(math.nan if n % 2 else 1.0)) for n in range(1, 6)]
    made = course("bounds", {"topic": "/v", "field": "data", "max": 2}, recorded)
    assert (made["points"], made["odd"]) == ([[2.0, 1.0], [4.0, 1.0]], [1.0, 3.0, 5.0])
    many = [("/v", 10.0 + n / 100, number(math.inf)) for n in range(500)]
    assert len(course("bounds", {"topic": "/v", "field": "data", "max": 2}, many)["odd"]) == 20


# How many points are kept is a matter of how many messages there are, not of their encoding.
@pytest.mark.parametrize("form", ["ros1"], indirect=True)
def test_the_courses_of_a_case_have_a_bound_together() -> None:
    recorded = [("/v", 10 + n / 1000, number(math.sin(n))) for n in range(9000)]
    bound = {"topic": "/v", "field": "data", "minCoverage": 0}
    passing = [criterion("bounds", bound | {"max": 2.0})]
    failing = [criterion("bounds", bound | {"max": 0.5})]
    for passed, failed in ((1, 0), (20, 0), (1, 1), (0, 20), (20, 80)):
        found = evaluate(passing * passed + failing * failed, evidence(recorded))
        lengths = [len(each.as_row()["course"]["points"]) for each in found]
        most = MOST_PASSED_POINTS_OF_ALL // passed if passed else 0
        assert set(lengths[:passed]) <= {min(MOST_PASSED_POINTS, most) // 2 * 2}
        most = MOST_POINTS_OF_ALL // failed if failed else 0
        assert all(min(MOST_POINTS, most) - 5 <= each <= most for each in lengths[passed:])
    rows = [each.as_row() for each in found]
    assert len(rows) == 100
    assert sum(len(json.dumps(row["course"]["points"])) for row in rows) < 50_000


@pytest.mark.parametrize(
    ("kind", "fields", "paths", "goal"),
    [
        (
            "finalPose", {"topic": "/p", "position": [0, 1], "maxDistance": 1, "minCoverage": 0.5},
            {"/p": [[1.0, 3.0, 4.0], [2.0, 6.0, 8.0]]}, [0.0, 1.0, 1.0],
        ),
        (
            "separation", {"ego": "/p", "obstacles": "/o", "minDistance": 2},
            {"/p": [[1.2, 4.8, 6.4]], "nearest of /o": [[1.2, 3.0, 5.0]]}, None,
        ),
        (
            "error", {"topic": "/p", "fields": ["pose.position.y", "pose.position.x"],
                      "recording": True, "max": 1},
            {"/p": [[1.0, 3.0, 4.0], [2.0, 6.0, 8.0]],
             "the truth": [[1.0, 1.0, 4.0], [2.0, 1.0, 8.0]]}, None,
        ),
    ],
)  # fmt: skip
def test_poses_have_paths_in_the_plane(
    kind: str, fields: dict[str, Any], paths: dict[str, Any], goal: list[float] | None
) -> None:
    [found] = evaluate([criterion(kind, fields)], evidence(RECORDED, SOURCE, end=12.5))
    plane = found.as_row()["course"]["plane"]
    assert {path["name"]: path["points"] for path in plane["paths"]} == paths
    assert plane["goal"] == goal


def test_a_path_keeps_its_ends_and_has_a_bound() -> None:
    path = [(n, float(n), math.nan if n == 3 else 0.0) for n in range(1001)]
    thin = plane.thinned(path, 50)
    assert (len(thin), thin[0][0], thin[-1][0]) == (50, 0, 1000)
    assert max(b[0] - a[0] for a, b in itertools.pairwise(thin)) <= 22
    assert plane.thinned(path[:5], 50) == [*path[:3], path[4]]
    assert (plane.thinned(path, 1), plane.thinned(path, 0)) == ([path[0]], [])
    one = criterion("error", {"topic": "/p", "fields": ["pose.position.x"], "recording": True,
                              "max": 1})  # fmt: skip
    [found] = evaluate([one], evidence(RECORDED, SOURCE, end=12.5))
    assert "plane" not in found.as_row()["course"]


def test_an_expression_is_computed_once(monkeypatch: pytest.MonkeyPatch) -> None:
    asked: list[object] = []
    answer = values._answer

    def noted(*given: Any) -> bool:
        asked.append(given)
        return answer(*given)

    monkeypatch.setattr(values, "_answer", noted)
    fields = {"topic": "/v", "holds": "msg.data < 6.5", "minCoverage": 0}
    assert len(course("expression", fields, RECORDED)["points"]) == len(asked) == 3


def test_a_course_is_small_and_json() -> None:
    values = [number(math.sin(n) * 1e-7 / 3) for n in range(5000)] + [number(math.nan)]
    recorded = [("/v", 10 + n / 1000, value) for n, value in enumerate(values)]
    [found] = evaluate(
        [criterion("bounds", {"topic": "/v", "field": "data", "min": 1})], evidence(recorded)
    )
    row = found.as_row()
    assert MOST_POINTS - 5 <= len(row["course"]["points"]) <= MOST_POINTS
    assert len(json.dumps(row["course"], allow_nan=False)) < 10_000


def test_thinning_keeps_ends_of_peaks() -> None:
    course = [(n, math.sin(n / 50)) for n in range(10_000)]
    course[7777] = (7777, 99.0)
    thin = thinned(course)
    assert len(thin) <= MOST_POINTS
    assert (7777, 99.0) in thin
    assert thin == sorted(thin)


def test_of_every_stretch_its_least_and_its_greatest_stay_in_order() -> None:
    course = list(enumerate([5.0, 1.0, 3.0, 2.0, 9.0, 4.0]))
    assert thinned(course, 6) == course
    assert thinned(course[:5], 5) == course[:5]
    assert thinned(course, 5) == thinned(course, 4) == [(0, 5.0), (1, 1.0), (3, 2.0), (4, 9.0)]
    assert thinned(course, 2) == [(1, 1.0), (4, 9.0)]
    # A stretch that stays the same is one point.
    assert thinned([(n, 7.0) for n in range(9)], 6) == [(0, 7.0), (3, 7.0), (6, 7.0)]
    assert len(thinned([(n, n % 7) for n in range(MOST_POINTS + 1)])) <= MOST_POINTS


@pytest.mark.parametrize("criteria", [1, 20])
@pytest.mark.parametrize(("bound", "sign"), [("max", 1), ("min", -1)])
def test_the_first_message_that_is_out_of_bounds_is_known_however_many_there_are(
    criteria: int, bound: str, sign: int
) -> None:
    """A slow ramp, which the greatest value of a stretch would put seconds too late."""
    recorded = [("/v", 10 + n / 1000, number(sign * n)) for n in range(3000)]
    wanted = criterion("bounds", {"topic": "/v", "field": "data", bound: sign * 1501.5})
    for finding in evaluate([wanted] * criteria, evidence(recorded)):
        assert moment_of(finding.as_row() | {"kind": "bounds"}) == 1.502


def test_the_last_pose_is_kept_where_it_is_neither_the_nearest_nor_the_farthest() -> None:
    distances = [50 - n / 200 for n in range(3000)] + [0.9, 0.4, 2.0]
    recorded = [("/p", 10 + n / 1000, stamped(10, x, 0.0)) for n, x in enumerate(distances)]
    fields = {"topic": "/p", "position": [0, 0], "maxDistance": 1, "minCoverage": 0}
    many = [criterion("finalPose", fields)] * 20
    for finding in evaluate(many, evidence(recorded)):
        assert moment_of(finding.as_row() | {"kind": "finalPose"}) == 3.002


def test_a_bound_that_was_just_passed_is_passed_by_what_is_kept() -> None:
    recorded = [("/v", 10.0 + n, number(value)) for n, value in enumerate([9.0, 10.000001, 9.5])]
    made = course("bounds", {"topic": "/v", "field": "data", "max": 10}, recorded)
    assert made["points"] == [[0.0, 9.0], [1.0, 10.000001], [2.0, 9.5]]


def test_coordinates_of_a_map_keep_the_digits_that_change() -> None:
    recorded = [("/v", 10.0 + n, number(5400120.0 + n / 3)) for n in range(9)]
    made = course("bounds", {"topic": "/v", "field": "data", "max": 5400122}, recorded)
    assert [value for _, value in made["points"][:3]] == [5400120.0, 5400120.3333, 5400120.6667]
    drive = [(n, 500120.0 + n / 3, 5400120.0) for n in range(9)]
    [drawn] = plane.Plane([("/p", drive)]).as_json(0, 100)["paths"]
    assert [x for _, x, _ in drawn["points"][:3]] == [500120.0, 500120.33333, 500120.66667]


def course(kind: str, fields: dict[str, Any], recorded: list[Any], **more: Any) -> dict[str, Any]:
    [found] = evaluate([criterion(kind, fields)], evidence(recorded, **more))
    assert found.outcome == "failed"
    made: dict[str, Any] = found.as_row()["course"]
    return made


def test_points_are_to_a_tenth_of_a_millisecond_and_five_digits() -> None:
    recorded = [("/v", 10.12345678, number(1.23456789)), ("/v", 19.0, number(-123456.0))]
    made = course("bounds", {"topic": "/v", "field": "data", "min": 9, "max": 99}, recorded)
    assert (made["low"], made["high"]) == (9.0, 99.0)
    assert made["points"] == [[0.1235, 1.2346], [9.0, -123460.0]]


def test_two_messages_of_one_time_have_no_rate_between_them() -> None:
    recorded = [("/v", at, number(at)) for at in (10.5, 10.5, 10.75, 11.75)]
    made = course("rate", {"topic": "/v", "max": 0.1}, recorded)
    assert made["points"] == [[0.75, 4.0], [1.75, 1.0]]


def test_the_distance_from_a_goal_is_that_on_the_ground() -> None:
    recorded = [("/p", 19.5, stamped(19.5, 4.0, 6.0))]
    fields = {"topic": "/p", "position": [1, 2, 50], "maxDistance": 1, "minCoverage": 0}
    assert course("finalPose", fields, recorded)["points"] == [[9.5, 5.0]]


def test_a_course_that_can_t_be_had_leaves_the_finding_as_it_is(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def broken(*_: object) -> None:
        raise KeyError("field")

    monkeypatch.setitem(courses._COURSES, "rate", broken)
    [found] = evaluate([criterion("rate", {"topic": "/v", "min": 9})], evidence(RECORDED))
    assert (found.outcome, found.course) == ("failed", None)
