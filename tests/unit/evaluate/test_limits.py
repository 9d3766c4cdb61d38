"""A figure against its bounds, which are allowed values themselves, and the words for it."""

import math

import pytest

from bagpipe.evaluate.finding import Finding
from bagpipe.evaluate.limits import bounded


@pytest.mark.parametrize(
    ("figure", "least", "most", "outcome", "message"),
    [
        (2.0, 2.0, 3.0, "passed", "2 m here"),
        (3.0, 2.0, 3.0, "passed", "3 m here"),
        (1.999, 2.0, 3.0, "failed", "1.999 m here, and may be 2 to 3 m"),
        (3.001, 2.0, 3.0, "failed", "3.001 m here, and may be 2 to 3 m"),
        (2.0, 2.0, None, "passed", "2 m here"),
        (1.999, 2.0, None, "failed", "1.999 m here, and may be at least 2 m"),
        (3.0, None, 3.0, "passed", "3 m here"),
        (3.001, None, 3.0, "failed", "3.001 m here, and may be at most 3 m"),
        (0.0, 0.0, 0.0, "passed", "0 m here"),
        (math.inf, 2.0, None, "passed", "inf m here"),
        (math.nan, 2.0, None, "failed", "nan m here, and may be at least 2 m"),
        (math.nan, None, 3.0, "failed", "nan m here, and may be at most 3 m"),
        (None, None, 3.0, "failed", "no number here, and may be at most 3 m"),
    ],
)
def test_a_figure_passes_from_bound_to_bound_and_one_that_is_no_number_never(
    figure: float | None, least: float | None, most: float | None, outcome: str, message: str
) -> None:
    found = bounded(Finding("c", "bounds", "passed", figure, "m"), least, most, "here")
    assert (found.outcome, found.figure is figure) == (outcome, True)
    assert found.message == message


@pytest.mark.parametrize(
    ("unit", "least", "most", "limit"),
    [
        ("m", 0.5, 3.0, "0.5 to 3 m"),
        ("m", 0.5, None, "at least 0.5 m"),
        ("m", None, 3.0, "at most 3 m"),
        ("", 0.5, 3.0, "0.5 to 3"),
        ("", 0.5, None, "at least 0.5"),
        ("", None, 3.0, "at most 3"),
    ],
)
def test_a_limit_is_written_with_its_unit_if_it_has_one(
    unit: str, least: float | None, most: float | None, limit: str
) -> None:
    found = bounded(Finding("c", "bounds", "passed", 9.0, unit), least, most, "here")
    assert found.limit == limit
    assert found.message == f"9 {unit} here".replace("  ", " ") + (
        f", and may be {limit}" if most else ""
    )


def test_integers_that_are_no_floats_are_written_as_they_are() -> None:
    figure = Finding("c", "bounds", "passed", 2**53 + 2)
    assert bounded(figure, -(2**53) - 1, 2**53 + 1, "here").message == (
        "9007199254740994 here, and may be -9007199254740993 to 9007199254740993"
    )
    few = Finding("c", "bounds", "passed", 2**53 - 1)
    assert bounded(few, None, 2.0**53, "here").limit == "at most 9.0072e+15"
    assert bounded(few, None, 2.0**53, "here").message == "9.0072e+15 here"
