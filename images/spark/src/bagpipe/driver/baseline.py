"""The rows of an earlier job that this one is compared with (spec.baseline)."""

import posixpath
from collections.abc import Iterator

from bagpipe.report.stored import StoredResults
from bagpipe.run.case_run import Row
from bagpipe.spec import FoundBaseline
from bagpipe.storage import Storage, StorageError

# All that a comparison reads: a row's timings, usage and the stack's words are left where they are.
_COMPARED = (
    "case", "fragment", "variant", "values", "seed", "round", "bag", "parts", "outcome", "reason",
    "criteria", "attempts", "starts", "discarded", "evidence",
    "allowed", "window", "bag_version",
)  # fmt: skip


def check_baseline(results: str, storage: Storage, found: FoundBaseline | None = None) -> None:
    """Raises StorageError, with what to write, unless a job has published whole results there.

    All is read once before anything runs: hours of cases are not for a comparison that can't be.
    `found` is the job of spec.baseline.lastPassed, if it is that one's.
    """
    uri = posixpath.join(results, "results.jsonl")
    if not storage.exists(uri):
        raise StorageError(_gone(uri, found))
    if not sum(1 for _ in baseline_rows(results, storage)):
        raise StorageError(
            f"spec.baseline.results: {uri} has no case: write status.results of a job that ran some"
        )


def _gone(uri: str, found: FoundBaseline | None) -> str:
    if found is None:
        return f"spec.baseline.results: there is no {uri}: write status.results of a finished job"
    return (
        f"spec.baseline.lastPassed: {found.job}, the last job of the schedule {found.schedule} that"
        f" passed, has no results any more (there is no {uri}): bring them back, write"
        " baseline.results of another job, or have one run of the schedule pass without baseline"
    )


def baseline_rows(results: str, storage: Storage) -> Iterator[Row]:
    """The earlier job's rows, in short; of a job with variants those of its first.

    Raises StorageError that names the line.
    """
    for row in StoredResults(results, storage).baseline_rows():
        ledger = (row.get("result") or {}).get("ledger")
        yield {key: row.get(key) for key in _COMPARED} | {"result": {"ledger": ledger}}
