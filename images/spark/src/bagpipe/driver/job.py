"""A job's work, wherever its cases run: plan, run what the journal does not have, commit."""

import logging
import os
import signal
import sys
import tempfile
import threading
from abc import ABC, abstractmethod
from collections.abc import Callable
from functools import partial
from pathlib import Path
from types import FrameType

from bagpipe.driver.baseline import check_baseline
from bagpipe.driver.chosen import NoCaseError
from bagpipe.driver.comparing import Compared, compared
from bagpipe.driver.earlier import CannotResumeError, passed_rows
from bagpipe.driver.first_plan import has_begun
from bagpipe.driver.job_day import job_day
from bagpipe.driver.journal import Journal
from bagpipe.driver.keep import INTERRUPTED, Keeper
from bagpipe.driver.own_pods import Seen
from bagpipe.driver.patience import patiently
from bagpipe.driver.progress import Progress
from bagpipe.driver.results import Manifest, Results
from bagpipe.driver.row_file import RowFile
from bagpipe.driver.running_order import in_running_order
from bagpipe.driver.same_catalogue import check_selection
from bagpipe.driver.same_recordings import of_the_same_recordings
from bagpipe.driver.spark_gone import SparkGoneError
from bagpipe.evaluate.judge import faults
from bagpipe.installed import InstallationError
from bagpipe.matrix.faults import MatrixError
from bagpipe.plan.case import Case
from bagpipe.plan.made import Plan
from bagpipe.quarantine import Quarantine, QuarantineError, too_long
from bagpipe.run.case_run import Row
from bagpipe.source.catalogue.faults import CatalogueError
from bagpipe.source.planning import plan
from bagpipe.spec import JobFile
from bagpipe.storage import Storage, StorageError

# A shell's status of a process that SIGTERM ended; the termination message says that this was an
# orderly end.
INTERRUPTED_STATUS = 128 + signal.SIGTERM
# Neither 0 nor 1, which are the ends of a job: this one has not ended.
_SPARK_GONE_STATUS = os.EX_TEMPFAIL
_REASONS: list[tuple[type[Exception], str]] = [
    (CannotResumeError, "ResumeRefused"),
    (QuarantineError, "QuarantineInvalid"),
    (StorageError, "StorageFailed"),
    (CatalogueError, "CatalogueInvalid"),
    (MatrixError, "MatrixInvalid"),
    (NoCaseError, "NoCaseChosen"),
]

log = logging.getLogger("bagpipe.driver")


class Interruption:
    """SIGTERM, which the kubelet sends when the pod is deleted: suspended, drained, evicted."""

    def __init__(self) -> None:
        self.keeper: Keeper | None = None
        self.came = False
        # What ends the wait for another job, while no job runs.
        self.waiting: Callable[[], None] | None = None

    def keep(self, keeper: Keeper) -> None:
        """There are rows to keep from now on."""
        self.keeper = keeper
        if self.came:  # and what the handler raised was lost, as in a callback of an import
            keeper.interrupt()

    def __call__(self, _signal: int, _frame: FrameType | None) -> None:
        """The signal's handler; before there are rows to keep, the driver ends at once."""
        self.came = True
        if self.waiting is not None:
            self.waiting()
            return
        if self.keeper is None:
            sys.exit(INTERRUPTED_STATUS)
        self.keeper.interrupt()


def job_of(file: Path) -> JobFile:
    """The job that is to run; raises SystemExit with a sentence where an engine can't be used."""
    try:
        return JobFile.model_validate_json(file.read_bytes())
    except InstallationError as error:
        sys.exit(f"bagpipe.driver: {error}")


def ended(progress: Progress, work: Callable[[], bool]) -> bool:
    """Do a job's work; what it raises becomes the progress' last word. True when Complete.

    Raises SystemExit after an interruption, and where Spark is gone.
    """
    try:
        return work()
    except SystemExit:
        progress.interrupt()
        raise
    except SparkGoneError as error:
        log.exception("the driver can't go on")
        progress.lose(str(error))
        sys.exit(_SPARK_GONE_STATUS)
    except Exception as error:  # the last word of a driver must be a reason
        for kind, reason in _REASONS:
            if isinstance(error, kind):
                progress.fail(reason, str(error))
                return False
        log.exception("the driver failed")
        progress.fail("DriverFailed", f"{type(error).__name__}: {error}")
        return False


class Place(ABC):
    """Where a job's cases run."""

    def __init__(self) -> None:
        self.seen = Seen()

    def planned(self, job: JobFile, storage: Storage) -> Plan:
        """The job's cases. Raises MatrixError."""
        return plan(job.spec, storage)

    def with_all_named(self, planned: Plan) -> Plan:
        """The first driver's plan, which has all that is chosen by name. Raises NoCaseError."""
        return planned

    def wanted(self, planned: Plan) -> Plan:
        """Those of them that are to run. Raises NoCaseError."""
        return planned

    @abstractmethod
    def run_cases(self, job: JobFile, cases: list[Case], keeper: Keeper) -> None:
        """Run the cases; their rows go to the keeper. Raises SparkGoneError."""


def run(
    job: JobFile,
    progress: Progress,
    place: Place,
    interruption: Interruption | None = None,
    counted: Callable[[Row], None] = lambda _row: None,
) -> bool:
    """Plan, run what the journal does not have, and commit; True when the job is Complete.

    Raises CannotResumeError, QuarantineError, StorageError, SparkGoneError, and SystemExit after an
    interruption.
    """
    storage = Storage(job.volumes)
    results = Results(job, storage)
    journal = Journal(storage, results.folder, job.attempt)
    if manifest := results.committed():
        return _adopted(results, manifest, journal, progress)
    if wrong := faults(job.spec.evaluate):
        progress.fail("CriteriaInvalid", "; ".join(wrong))
        return False
    if job.spec.compared_with is not None:
        check_baseline(job.spec.compared_with, storage, job.baseline)
    patiently(partial(storage.check_put_once, results.folder), progress)
    quarantine = _quarantine(job, results, progress)
    planned = _planned(job, place, results, journal, progress)
    progress.look_at(quarantine)
    progress.begin(len(planned.cases) + len(planned.unplanned))
    with tempfile.TemporaryDirectory() as folder, RowFile(Path(folder, "rows")) as rows:
        keeper = Keeper(
            progress, rows, journal, job.spec.max_failed_cases, results.is_committed,
            counted=counted, quarantine=quarantine,
        )  # fmt: skip
        if interruption is not None:
            interruption.keep(keeper)
        if manifest := _taken_away(keeper, planned, results):
            return _adopted(results, manifest, journal, progress)
        if job.resume is not None:
            taken = keeper.take_over(passed_rows(job.resume, planned, storage))
            log.info("%d cases were taken over from job %s", taken, job.resume.job)
        _run_the_rest(place, job, planned, keeper, storage)
        stop = keeper.stop  # one look: a signal may come between two
        if stop is not None and stop.reason == INTERRUPTED:
            sys.exit(INTERRUPTED_STATUS)
        if stop is not None:
            progress.stop(stop.reason, stop.message)
        if stop is not None and not stop.final:
            progress.finish()
            return _unfinished(results, journal, progress)
        progress.compare(_compared(job, rows, storage, progress))
        commit = partial(results.commit, rows, progress, journal.driver, place.seen)
        manifest = patiently(commit, progress)
        ours = manifest["driver"] == journal.driver
        publish = partial(results.publish, manifest, rows.rows if ours else journal.rows, journal)
        patiently(publish, progress)
        progress.adopt(manifest)
    return progress.phase == "Complete"


def _compared(job: JobFile, rows: RowFile, storage: Storage, progress: Progress) -> Compared:
    keep_trying = partial(patiently, progress=progress)
    return compared(job.spec, rows.rows, storage, keep_trying, job.baseline)


def _quarantine(job: JobFile, results: Results, progress: Progress) -> Quarantine:
    """The job's rules on its day. Raises StorageError and QuarantineError."""
    rules = job.spec.quarantine
    if not rules:
        return Quarantine()
    day = patiently(partial(job_day, results.storage, results.folder, progress.began), progress)
    if wrong := too_long(rules, day):
        raise QuarantineError("; ".join(wrong))
    return Quarantine(rules, day)


def _planned(
    job: JobFile, place: Place, results: Results, journal: Journal, progress: Progress
) -> Plan:
    """What is to run, of the recordings and the choice of cases that the job began with.

    Raises MatrixError, NoCaseError, CatalogueError and StorageError.
    """
    found = place.planned(job, results.storage)
    log.info("%d cases planned, %d bags refused", len(found.cases), len(found.unplanned))
    _keep_selection(found, results, progress)
    if not patiently(partial(has_begun, results.storage, results.folder), progress):
        found = place.with_all_named(found)
    same = partial(
        of_the_same_recordings, results.storage, results.folder, found, journal.rows, place.wanted
    )
    return patiently(same, progress)


def _keep_selection(planned: Plan, results: Results, progress: Progress) -> None:
    """By which catalogue the cases were planned. Raises StorageError and CatalogueError."""
    if planned.selection is not None:
        keep = partial(check_selection, results.storage, results.folder, planned.selection)
        patiently(keep, progress)
        progress.select(planned.selection)


def _taken_away(keeper: Keeper, planned: Plan, results: Results) -> Manifest | None:
    """Take what the journal has; a driver that has committed removes it, also while it is read.

    Gives that one's manifest. Raises StorageError where it is not the reason.
    """
    try:
        keeper.resume(planned)
    except StorageError:
        manifest = results.committed()
        if manifest is None:
            raise
        return manifest
    return None


def _run_the_rest(
    place: Place, job: JobFile, planned: Plan, keeper: Keeper, storage: Storage
) -> None:
    """Run the cases without a row; however that ends, the rows there are reach the journal."""
    left = [case for case in planned.cases if case.id not in keeper.rows]
    log.info("%d cases were done before, %d are to run", len(keeper.rows), len(left))
    try:
        if left and keeper.stop is None:
            place.run_cases(job, in_running_order(job, left, storage), keeper)
    finally:
        keeper.finish(threading.Event())


def _adopted(results: Results, manifest: Manifest, journal: Journal, progress: Progress) -> bool:
    """Another driver has committed: finish what it may have left, and report its result."""
    log.info("attempt %s of this job has committed; nothing is run", manifest["attempt"])
    progress.adopt(manifest)
    if not results.is_published(journal):
        patiently(partial(results.publish, manifest, journal.rows, journal), progress)
    return progress.phase == "Complete"


def _unfinished(results: Results, journal: Journal, progress: Progress) -> bool:
    """The work stopped for a fault that is not the job's own: leave the journal to a successor."""
    try:
        manifest = results.committed()
    except StorageError as error:
        # Logged only: the job's reason stays the one for which the work stopped.
        log.warning("could not look for another driver's manifest: %s", error)
        return False
    return manifest is not None and _adopted(results, manifest, journal, progress)
