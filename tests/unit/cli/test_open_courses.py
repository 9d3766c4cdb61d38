"""Courses of criteria as `bagpipe open` shows them, and the moments that it finds in them."""

import json
from typing import Any

from bagpipe.moments import Moment, moments
from bagpipe.view.course import notes

SECOND = 1_000_000_000


def finding(name: str, points: list[list[float]], kind: str = "bounds") -> dict[str, Any]:
    found = {"name": name, "kind": kind, "outcome": "failed", "message": f"why {name}"}
    course = {"label": "x", "unit": "m", "low": None, "high": 1.0, "points": points}
    return found | {"course": course}


def test_a_final_pose_is_wrong_in_the_end_and_not_where_the_drive_began() -> None:
    far = [[0.0, 90.0], [3.0, 40.0], [5.9, 2.5]]
    assert moments({"criteria": [finding("goal", far, "finalPose")]}) == [
        Moment(5.9, "goal: why goal")
    ]
    # In place, and not in its heading.
    near = [[0.0, 90.0], [5.9, 0.5]]
    assert moments({"criteria": [finding("goal", near, "finalPose")]}) == []


def test_a_count_has_a_moment_where_it_is_exceeded_and_none_where_it_is_not_reached() -> None:
    counted = finding("count", [[0.0, 0.0], [1.0, 1.0], [2.0, 2.0]], "presence")
    counted["course"] |= {"low": 9, "high": None}
    assert moments({"criteria": [counted]}) == []
    counted["course"] |= {"low": 0, "high": 1}
    assert moments({"criteria": [counted]}) == [Moment(2.0, "count: why count")]


def test_an_expression_fails_where_it_first_does_not_hold() -> None:
    share = finding("share", [[1.0, 1.0], [2.0, 0.0], [3.0, 0.0]], "expression")
    share["course"] |= {"low": None, "high": None}
    assert moments({"criteria": [share]}) == [Moment(2.0, "share: why share")]


def test_what_is_no_number_is_out_of_its_bounds() -> None:
    found = finding("x", [[0.5, 0.9], [7.0, 3.0]])
    found["course"]["odd"] = [float("nan"), 4.0, 5.0]
    assert moments({"criteria": [found]}) == [Moment(4.0, "x: why x")]
    assert moments({"criteria": [found | {"outcome": "passed"}]}) == []


def test_criteria_of_names_that_topics_can_not_have_have_topics_of_their_own() -> None:
    names = ["in lane", "in-lane", "in_lane", "in_lane_2", "車線"]
    row = {"criteria": [finding(name, [[0.0, 2.0]]) for name in names]}
    topics = [each.topic for each in notes(row, moments(row), 0)]
    prefix = "/bagpipe/criteria"
    assert topics[:5] == [
        f"{prefix}/in_lane",
        f"{prefix}/in_lane_2",
        f"{prefix}/in_lane_3",
        f"{prefix}/in_lane_2_2",
        f"{prefix}/__",
    ]


def test_numbers_that_are_none_are_not_shown() -> None:
    found = finding("x", [[0.0, float("nan")], [1.0, float("inf")], [2.0, 3.0]])
    found["course"]["low"] = float("-inf")
    row = {"criteria": [found]}
    made = list(notes(row, moments(row), 0))
    assert [json.loads(each.data) for each in made[:-1]] == [{"value": 3.0, "high": 1.0}]
    assert [each.time for each in made] == [2 * SECOND, 2 * SECOND]
