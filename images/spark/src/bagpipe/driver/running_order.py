"""In which order a job's cases begin: by the seconds that jobs it names took for them."""

import itertools
import logging
from collections.abc import Iterator

from bagpipe.driver.earlier import CannotResumeError, all_rows
from bagpipe.plan.case import Case
from bagpipe.plan.expected import earlier_of, longest_first
from bagpipe.report.stored import StoredResults
from bagpipe.run.case_run import Row
from bagpipe.spec import JobFile
from bagpipe.storage import Storage, StorageError

# Of each earlier job: as many cases as a driver was measured with.
_MOST_ROWS = 100_000

log = logging.getLogger(__name__)


def in_running_order(job: JobFile, cases: list[Case], storage: Storage) -> list[Case]:
    """The cases, the longest first where spec.resumeFrom or spec.baseline shows how long they take.

    An order is not worth a job: what can't be read leaves the cases as they were planned.
    """
    try:
        return longest_first(cases, earlier_of(_earlier_rows(job, storage)))
    except (StorageError, CannotResumeError) as error:
        log.warning("the cases begin in the order of their bytes: %s", error)
    except (ArithmeticError, AttributeError, KeyError, TypeError, ValueError) as error:
        # Results are files that anybody may have written.
        log.warning("the cases begin in the order of their bytes: a row is damaged: %r", error)
    return list(cases)


def _earlier_rows(job: JobFile, storage: Storage) -> Iterator[Row]:
    """Of cases that passed: one that crashed after a second is no short one once it is mended."""
    return (row for row in _all_rows(job, storage) if row.get("outcome") == "passed")


def _all_rows(job: JobFile, storage: Storage) -> Iterator[Row]:
    if job.resume is not None:
        yield from itertools.islice(all_rows(job.resume, storage), _MOST_ROWS)
    if job.spec.compared_with is not None:
        rows = StoredResults(job.spec.compared_with, storage).rows()
        yield from itertools.islice(rows, _MOST_ROWS)
