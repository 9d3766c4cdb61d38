"""What the job of spec.resumeFrom has done: its passed cases, as rows of the job that goes on.

A committed job has its rows in results.jsonl, one that was ended before it could commit in its
journal. What it recorded stays where it is: a row that is taken over names it by its whole URI.
"""

import posixpath
from collections.abc import Iterator

from bagpipe.driver.journal import Journal, read_row
from bagpipe.plan.made import Plan
from bagpipe.row_facts import badness, recorded_names
from bagpipe.run.case_run import Row, is_of
from bagpipe.spec import EarlierResults
from bagpipe.storage import Storage, StorageError


class CannotResumeError(Exception):
    """The earlier job's results can't be taken over; the message is a sentence for the user."""


def passed_rows(earlier: EarlierResults, planned: Plan, storage: Storage) -> Iterator[Row]:
    """The earlier job's cases that passed and belong to this plan, each with its rows' figures.

    Cases that failed, gave no evidence or errored are left out, so that they run again. So is one
    of which two drivers left rows, and one of these speaks against it. Raises CannotResumeError
    where the two plans are not the same, or the results can't be read.
    """
    now = len(planned.cases) + len(planned.unplanned)
    if now != earlier.cases:
        raise CannotResumeError(
            f"job {earlier.job} planned {earlier.cases} cases and this one has {now}: its bags"
            " have changed since, or another release planned it. Leave out spec.resumeFrom to run"
            " all cases."
        )
    cases = {case.id: case for case in planned.cases}
    doubted = _doubted(earlier, storage)
    taken: set[str] = set()
    for row in all_rows(earlier, storage):
        if "window" not in row or row["case"] in taken:  # a bag that yields no case
            continue
        case = cases.get(row["case"])
        if case is None or not is_of(row, case):
            raise CannotResumeError(
                f"case {row['case']} of job {earlier.job} was made of {row['bag']} as it was then,"
                " and is not among this job's cases: the bag has changed since, or another release"
                " planned it. Leave out spec.resumeFrom to run all cases."
            )
        if row["outcome"] == "passed" and row["case"] not in doubted:
            taken.add(row["case"])
            yield _taken_over(row, earlier)


def _doubted(earlier: EarlierResults, storage: Storage) -> set[str]:
    """Cases against which some row speaks, of results that may have several of one case."""
    if _committed(earlier, storage):
        return set()
    return {row["case"] for row in all_rows(earlier, storage) if badness(row) > 0}


def _committed(earlier: EarlierResults, storage: Storage) -> str:
    """The results that have one row for each case; empty where there are none."""
    uri = posixpath.join(earlier.results, "results.jsonl")
    try:
        return uri if storage.exists(uri) else ""
    except StorageError as error:
        raise _unreadable(earlier, error) from error


def _taken_over(row: Row, earlier: EarlierResults) -> Row:
    """The row with what it recorded as URIs, under the name of the job that really ran it."""
    uris = [
        name if "://" in name else posixpath.join(earlier.results, name)
        for name in recorded_names(row)
    ]
    recorded = uris if isinstance(row["recorded"], list) else next(iter(uris), None)
    return row | {"recorded": recorded, "ran_in": row.get("ran_in", earlier.job)}


def all_rows(earlier: EarlierResults, storage: Storage) -> Iterator[Row]:
    """Every row that the earlier job has left, whatever it came to. Raises CannotResumeError."""
    try:
        if uri := _committed(earlier, storage):
            for number, line in enumerate(storage.open(uri).lines(), start=1):
                yield read_row(line, uri, number)
            return
        journal = Journal(storage, earlier.results, attempt=0)
        if journal.is_empty():
            raise CannotResumeError(
                f"{earlier.results} holds neither results.jsonl nor a journal of job {earlier.job}:"
                " its results were removed. Leave out spec.resumeFrom to run all cases."
            )
        yield from journal.rows()
    except StorageError as error:
        raise _unreadable(earlier, error) from error


def _unreadable(earlier: EarlierResults, error: StorageError) -> CannotResumeError:
    return CannotResumeError(
        f"the results of job {earlier.job} can't be read: {error}. Make them readable, or"
        " leave out spec.resumeFrom to run all cases."
    )
