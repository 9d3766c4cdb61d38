"""A figure against its bounds, in the same words for every criterion."""

from collections.abc import Sequence
from dataclasses import replace

from bagpipe.evaluate.finding import Figure, Finding

# From there on not every integer is a float.
_EXACT = 2**53


def bounded(finding: Finding, least: float | None, most: float | None, where: str) -> Finding:
    """The finding as its figure lies between the bounds, both of which are allowed values.

    A figure that is no number fails.
    """
    figure = finding.figure
    limit = limits(least, most, finding.unit)
    inside = figure is not None and figure == figure  # noqa: PLR0124  NaN is the only other
    inside = inside and (least is None or figure >= least) and (most is None or figure <= most)  # type: ignore[operator]
    shown = "no number" if figure is None else f"{_shown(figure, '.6g')} {finding.unit}".strip()
    message = f"{shown} {where}, and may be {limit}" if not inside else f"{shown} {where}"
    return replace(finding, outcome="passed" if inside else "failed", limit=limit, message=message)


def of_all_bounds(found: Sequence[Finding], shown: Finding) -> Finding:
    """One finding of several figures, each held against its own bound, that keeps them all: the
    first that failed, or else `shown`.
    """
    decided = next((each for each in found if each.outcome == "failed"), shown)
    if len(found) == 1:
        return decided
    figures = (Figure(f.outcome, f.figure, f.unit, f.limit, f.direction) for f in found)
    return replace(decided, figures=tuple(figures))


def limits(least: float | None, most: float | None, unit: str) -> str:
    """Bounds as people write them."""
    of_unit = f" {unit}" if unit else ""
    low, high = ("" if each is None else _shown(each, "g") for each in (least, most))
    if least is not None and most is not None:
        return f"{low} to {high}{of_unit}"
    return f"at least {low}{of_unit}" if least is not None else f"at most {high}{of_unit}"


def _shown(number: float, form: str) -> str:
    """An integer that is no float is written as it is: with the next one it would look alike."""
    exact = isinstance(number, int) and abs(number) >= _EXACT
    return str(number) if exact else format(number, form)
