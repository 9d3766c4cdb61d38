"""One run of a job as history sees it, read from its results.parquet in place."""

import math
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, NamedTuple

import pyarrow as pa
import pyarrow.parquet as pq

from bagpipe.storage import Storage, StorageError

_TABLE = "results.parquet"
_COLUMNS = ["case", "outcome", "seconds", "discarded", "criteria"]
# Tables of before there was a quarantine have none.
_LATER_COLUMNS = ["quarantine"]
_MOST_BYTES = 1 << 30
_BATCH = 1_000


class Measured(NamedTuple):
    """A figure, None where nothing could be measured, and a mark of what it is of, empty where that
    is not known.
    """

    unit: str
    figure: float | None
    measures: str = ""


# Of these there are millions.
@dataclass(frozen=True, slots=True)
class Found:
    """What a criterion found in a case: `figure`, `unit` and `measures` as in Measured, and
    `figures` where it has several.
    """

    name: str
    outcome: str
    figure: float | None
    unit: str
    figures: tuple[Measured, ...] = ()
    measures: str = ""

    @property
    def measured(self) -> tuple[Measured, ...]:
        """All its figures."""
        return self.figures or (Measured(self.unit, self.figure, self.measures),)


@dataclass(frozen=True, slots=True)
class CaseOfRun:
    """A case that ended: its outcome, seconds of all attempts, runs that did not count, and until
    when and why it is in quarantine (empty for one that counts).
    """

    name: str
    outcome: str
    seconds: float
    discarded: int
    criteria: tuple[Found, ...]
    quarantine: str = ""


@dataclass(frozen=True)
class Run:
    """A job that ended, and when (ISO 8601)."""

    results: str
    ended: str
    verdict: str
    cases: tuple[CaseOfRun, ...]

    @property
    def values(self) -> int:
        """How many cases and findings it holds."""
        return len(self.cases) + sum(len(case.criteria) for case in self.cases)


def read_run(listed: dict[str, Any], storage: Storage, most: int) -> Run:
    """The run of a folder of results, listed with `results`, `ended` and `verdict`.

    Raises StorageError where it has no table that can be read, or one of more than `most` cases or
    findings, which a file of a few kilobytes may have.
    """
    uri = f"{listed['results']}/{_TABLE}"
    data = storage.read_all(uri, _MOST_BYTES)
    try:
        table = pq.ParquetFile(pa.BufferReader(data))
        if _values(table.metadata) > most:
            raise StorageError(
                f"{uri} has more than {most:,} cases or findings, which is what is left for it:"
                " give a smaller --last"
            )
        cases = tuple(_cases(table))
    except (pa.ArrowException, AttributeError, KeyError, OSError, TypeError, ValueError) as error:
        raise StorageError(f"{uri} is no table of results: {error}") from error
    return Run(listed["results"], listed["ended"], listed["verdict"], cases)


def _values(metadata: pq.FileMetaData) -> int:
    """Of all columns the longest: a list's elements count one by one."""
    groups = (metadata.row_group(number) for number in range(metadata.num_row_groups))
    return sum(
        max((group.column(at).num_values for at in range(group.num_columns)), default=0)
        for group in groups
    )


def _cases(table: pq.ParquetFile) -> Iterator[CaseOfRun]:
    there = [name for name in _LATER_COLUMNS if name in table.schema_arrow.names]
    for batch in table.iter_batches(_BATCH, columns=_COLUMNS + there):
        for row in batch.to_pylist():
            yield _case(row)


def _case(row: dict[str, Any]) -> CaseOfRun:
    return CaseOfRun(
        _text(row["case"]),
        _text(row["outcome"]),
        _number(row["seconds"]) or 0.0,
        len(row["discarded"] or []),
        tuple(_found(each) for each in row["criteria"] or []),
        _text(row.get("quarantine") or ""),
    )


def _found(finding: dict[str, Any]) -> Found:
    measured = _measured(finding)
    return Found(
        _text(finding["name"]),
        _text(finding["outcome"]),
        measured.figure,
        measured.unit,
        # Of a criterion with several; tables of before have none.
        tuple(map(_measured, finding.get("figures") or [])),
        measured.measures,
    )


def _measured(figure: dict[str, Any]) -> Measured:
    """Tables of before have no marks."""
    return Measured(
        _text(figure["unit"] or ""), _number(figure["figure"]), _text(figure.get("measures") or "")
    )


def _text(value: Any) -> str:
    if not isinstance(value, str):
        raise TypeError(f"a name is of the type {type(value).__name__}")
    # The same few words in every line of every run.
    return sys.intern(value)


def _number(value: Any) -> float | None:
    """A finite one; what is none has no order, and no place in a median or in JSON."""
    if value is None:
        return None
    if not isinstance(value, int | float):
        raise TypeError(f"a figure is of the type {type(value).__name__}")
    return float(value) if math.isfinite(value) else None
