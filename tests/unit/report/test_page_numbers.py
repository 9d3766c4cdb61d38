"""The page is made whatever numbers a row has: rows may be anybody's."""

import json
import math
import re
from typing import Any

import pytest

from bagpipe.report.details import detail_of
from bagpipe.report.html import Report
from tests.unit.bagpipe.jobs import make_row
from tests.unit.report.test_page import MANIFEST

HUGE = 10**400


@pytest.mark.parametrize(
    "odd",
    [
        {"seconds": HUGE}, {"seconds": math.nan}, {"values": {"a": math.nan, "b": [-math.inf]}},
        {"log": [{"at": HUGE, "level": ["error"]}, {"at": 1, "level": ["error"]}]},
        {"discarded": [{"reason": "Lost", "message": None, "seconds": HUGE}]},
        {"window": [HUGE, HUGE, HUGE]}, {"evidence": {"starts": [{"seconds": HUGE}]}},
        {"result": {"timings": {"play": HUGE}, "machine": {"late_seconds": HUGE}}},
        {"criteria": [{"name": "c", "kind": "own", "outcome": "failed", "figure": HUGE,
                       "unit": None, "limit": None, "course": {"points": [[HUGE, 1], [1, HUGE]]}}]},
    ],
)  # fmt: skip
def test_a_number_that_no_page_can_show_is_left_out_and_the_page_is_made(
    odd: dict[str, Any],
) -> None:
    report = Report(None, "r")
    report.add(make_row("a", "failed", "Bad") | odd)
    page = report.html(MANIFEST).decode()
    found = re.search(r'id="data">(.*?)</script>', page, re.DOTALL)
    assert found is not None
    data = json.loads(found[1], parse_constant=pytest.fail)
    assert data["cases"]["case"] == ["a"]
    if "values" in odd:
        assert [each["values"] for each in data["variables"]] == [["nan"], [["-inf"]]]


def test_a_line_long_after_its_window_does_not_press_the_courses_together() -> None:
    window = [0, 5_000_000_000, 25_000_000_000]
    stderr = [f"[WARN] [1.5, {at}.0]: late" for at in (84, 85, 86, 999_999_999_999)]
    found = detail_of(make_row("a", "failed", "Bad", stderr=stderr, window=window))["lines"]
    assert [line["at"] for line in found] == [79.0, 80.0]
