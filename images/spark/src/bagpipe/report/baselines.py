"""Courses of the baseline's cases, to be laid over those of the cases that are shown in full."""

from collections.abc import Iterable, Mapping
from typing import Any

from bagpipe.report.details import fitting
from bagpipe.report.series import series_of
from bagpipe.report.spool import Spool
from bagpipe.row_facts import pair_of

Row = Mapping[str, Any]

MOST_BYTES = 2_000_000


class Baselines:
    """The baseline's case of each case: of the first variant, or of an earlier job.

    `first` is the variant that is the baseline; None where an earlier job is one, or nothing.
    """

    def __init__(self, spool: Spool, first: str | None, most_bytes: int = MOST_BYTES) -> None:
        self._spool = spool
        self._first = first
        self._most = most_bytes
        self._names: dict[str, str] = {}

    def add(self, row: Row) -> None:
        """One case of this job."""
        if self._first is not None and row.get("variant") == self._first:
            self._names.setdefault(pair_of(row), str(row["case"]))

    def of(self, shown: Iterable[str]) -> dict[str, dict[str, Any]]:
        """For each of the cases that has one the baseline's `case`, who that is (`called`), and its
        `series`, but for one that is shown itself. Raises OSError.
        """
        found: dict[str, dict[str, Any]] = {}
        names, taken = list(shown), 0
        there = frozenset(names)
        for name in names:
            other = self._names.get(self._spool.read(name)["pair"])
            if other is None or other == name:
                continue
            found[name] = {"case": other, "called": self._first}
            if other in there:
                continue
            detail, size = fitting(self._spool.read(other)["detail"])
            taken += size
            if taken > self._most:
                del found[name]
                break
            found[name]["series"] = detail["series"]
        return found

    def of_earlier(self, shown: Iterable[str], rows: Iterable[Row]) -> dict[str, dict[str, Any]]:
        """The same of an earlier job's rows, which are looked at once. Raises what these raise."""
        wanted: dict[str, list[str]] = {}
        for name in shown:
            wanted.setdefault(self._spool.read(name)["pair"], []).append(name)
        found: dict[str, dict[str, Any]] = {}
        taken = 0
        for row in rows:
            names = wanted.pop(pair_of(row), None)
            if names is None:
                continue
            detail, size = fitting({"series": series_of(row)})
            if taken + size * len(names) > self._most:
                break
            taken += size * len(names)
            for name in names:
                found[name] = {"case": str(row["case"]), "called": "the earlier job"} | detail
        return found
