"""Marks of what was measured, for results of releases that wrote none: by the job beside them."""

from collections.abc import Iterator, Mapping
from typing import Any

from pydantic import ValidationError

from bagpipe.evaluate.measured import earlier_mark_of
from bagpipe.evaluate.model import RAN, Criterion
from bagpipe.row_facts import figures_of, is_finite

Row = dict[str, Any]
_Figure = Mapping[str, Any]


class EarlierMarks:
    """The marks of a job's criteria, by its spec as it was stored.

    None for a criterion that has not today's form: what it measured is not known then.
    """

    def __init__(self, spec: Mapping[str, Any]) -> None:
        playback = spec.get("playback")
        playback = playback if isinstance(playback, Mapping) else {}
        self._mode, self._rate = str(playback.get("mode", "realtime")), playback.get("rate", 1.0)
        known = _criteria(spec) if is_finite(self._rate) else ()
        self._criteria = {each.name: each for each in known}
        # Of a million rows there are as many marks as of one.
        self._made: dict[tuple[str, str], str] = {}

    def added(self, row: Row) -> Row:
        """The row, with marks where figures have none."""
        findings = row.get("criteria") or []
        if all("measures" in each for of in findings for each in figures_of(of)):
            return row
        return row | {"criteria": [self._finding(each) for each in findings]}

    def _finding(self, finding: Row) -> Row:
        found = self._marked(finding, finding)
        if finding.get("figures"):
            found["figures"] = [self._marked(finding, each) for each in figures_of(finding)]
        return found

    def _marked(self, finding: _Figure, figure: _Figure) -> Row:
        """A figure of that finding, or the finding's own."""
        mark = self._mark(str(finding.get("name")), str(figure.get("unit") or ""))
        return {"measures": mark, **figure}

    def _mark(self, name: str, unit: str) -> str:
        criterion = self._criteria.get(name)
        if criterion is None:
            return ""
        if (name, unit) not in self._made:
            made = earlier_mark_of(criterion, unit, self._mode, self._rate)
            self._made[name, unit] = made
        return self._made[name, unit]


def _criteria(spec: Mapping[str, Any]) -> Iterator[Criterion]:
    given = spec.get("evaluate")
    for each in given if isinstance(given, list) else []:
        try:
            yield Criterion.model_validate(each, context={RAN: True})
        except ValidationError:
            continue
