"""One run of a job as history sees it, read from its results.parquet in place."""

from dataclasses import dataclass
from typing import Any

import pyarrow as pa
import pyarrow.parquet as pq

from bagpipe.storage import Storage, StorageError

_TABLE = "results.parquet"
_COLUMNS = ["case", "outcome", "seconds", "discarded", "criteria"]
_MOST_BYTES = 1 << 30


@dataclass(frozen=True)
class Found:
    """What a criterion found in a case. `figure` is None where nothing could be measured."""

    name: str
    outcome: str
    figure: float | None
    unit: str


@dataclass(frozen=True)
class CaseOfRun:
    """A case that ended: its outcome, seconds of all attempts, and runs that did not count."""

    name: str
    outcome: str
    seconds: float
    discarded: int
    criteria: tuple[Found, ...]


@dataclass(frozen=True)
class Run:
    """A job that ended, and when (ISO 8601)."""

    results: str
    ended: str
    verdict: str
    cases: tuple[CaseOfRun, ...]


def read_run(listed: dict[str, Any], storage: Storage) -> Run:
    """The run of a folder of results, listed with `results`, `ended` and `verdict`.

    Raises StorageError where it has no table that can be read.
    """
    uri = f"{listed['results']}/{_TABLE}"
    try:
        data = pa.BufferReader(storage.read_all(uri, _MOST_BYTES))
        rows = pq.read_table(data, columns=_COLUMNS).to_pylist()
        cases = tuple(_case(row) for row in rows)
    except (pa.ArrowException, KeyError, TypeError, ValueError) as error:
        raise StorageError(f"{uri} is no table of results: {error}") from error
    return Run(listed["results"], listed["ended"], listed["verdict"], cases)


def _case(row: dict[str, Any]) -> CaseOfRun:
    return CaseOfRun(
        row["case"],
        row["outcome"],
        row["seconds"] or 0.0,
        len(row["discarded"] or []),
        tuple(
            Found(each["name"], each["outcome"], each["figure"], each["unit"] or "")
            for each in row["criteria"] or []
        ),
    )
