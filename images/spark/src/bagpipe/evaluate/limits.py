"""A figure against its bounds, in the same words for every criterion."""

from collections.abc import Sequence
from dataclasses import replace

from bagpipe.evaluate.finding import Figure, Finding


def bounded(finding: Finding, least: float | None, most: float | None, where: str) -> Finding:
    """The finding as its figure lies between the bounds, both of which are allowed values.

    A figure that is no number fails.
    """
    figure = finding.figure
    limit = limits(least, most, finding.unit)
    inside = figure is not None and figure == figure  # noqa: PLR0124  NaN is the only other
    inside = inside and (least is None or figure >= least) and (most is None or figure <= most)  # type: ignore[operator]
    shown = "no number" if figure is None else f"{figure:.6g} {finding.unit}".strip()
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
    if least is not None and most is not None:
        return f"{least:g} to {most:g}{of_unit}"
    return f"at least {least:g}{of_unit}" if least is not None else f"at most {most:g}{of_unit}"
