"""The rows of an earlier job that this one is compared with (spec.baseline)."""

import posixpath
from collections.abc import Iterator

from bagpipe.report.stored import StoredResults
from bagpipe.run.case_run import Row
from bagpipe.storage import Storage, StorageError

_COMPARED = ("case", "fragment", "variant", "values", "seed", "round", "outcome", "criteria")


def check_baseline(results: str, storage: Storage) -> None:
    """Raises StorageError, with what to write, unless a job has published its results there."""
    uri = posixpath.join(results, "results.jsonl")
    if not storage.exists(uri):
        raise StorageError(
            f"spec.baseline.results: there is no {uri}: write status.results of a finished job"
        )


def baseline_rows(results: str, storage: Storage) -> Iterator[Row]:
    """The earlier job's rows, without their ledgers; of a job with variants those of its first.

    Raises StorageError that names the line.
    """
    for row in StoredResults(results, storage).baseline_rows():
        yield {key: row.get(key) for key in _COMPARED}
