"""`python -m bagpipe.driver --job /etc/bagpipe/job.json`: the driver pod's only process."""

import argparse
import json
import logging
import os
import signal
import sys
import tempfile
import threading
from collections.abc import Callable
from functools import partial
from pathlib import Path
from types import FrameType

from pyspark import SparkConf, SparkContext

from bagpipe.driver.baseline import check_baseline
from bagpipe.driver.cases_on_spark import SparkGoneError, run_cases
from bagpipe.driver.chosen import NoCaseError
from bagpipe.driver.comparing import compared
from bagpipe.driver.earlier import CannotResumeError, passed_rows
from bagpipe.driver.journal import Journal
from bagpipe.driver.keep import Keeper
from bagpipe.driver.metrics import DriverMetrics
from bagpipe.driver.own_pods import Looking, Seen, pods_of
from bagpipe.driver.patience import patiently
from bagpipe.driver.progress import Progress
from bagpipe.driver.progress_server import serve_progress
from bagpipe.driver.results import Manifest, Results, results_uri
from bagpipe.driver.row_file import RowFile
from bagpipe.driver.spark_context import CLASS_ARCHIVE, DriverPod, spark_settings
from bagpipe.evaluate.judge import faults
from bagpipe.installed import InstallationError
from bagpipe.matrix.faults import MatrixError
from bagpipe.plan.case import Case
from bagpipe.plan.made import Plan
from bagpipe.run.case_run import Row, RunContext
from bagpipe.source.planning import plan
from bagpipe.spec import JobFile
from bagpipe.storage import Storage, StorageError

PROGRESS_PORT = 8080
_TERMINATION_LOG = Path("/dev/termination-log")
# A shell's status of a process that SIGTERM ended; the termination message says that this was an
# orderly end.
_INTERRUPTED_STATUS = 128 + signal.SIGTERM
# Neither 0 nor 1, which are the ends of a job: this one has not ended.
_SPARK_GONE_STATUS = os.EX_TEMPFAIL
_REASONS: list[tuple[type[Exception], str]] = [
    (CannotResumeError, "ResumeRefused"),
    (StorageError, "StorageFailed"),
    (MatrixError, "MatrixInvalid"),
    (NoCaseError, "NoCaseChosen"),
]

log = logging.getLogger("bagpipe.driver")


class Interruption:
    """SIGTERM, which the kubelet sends when the pod is deleted: suspended, drained, evicted."""

    def __init__(self) -> None:
        self.keeper: Keeper | None = None

    def __call__(self, _signal: int, _frame: FrameType | None) -> None:
        """The signal's handler; before there are rows to keep, the driver ends at once."""
        if self.keeper is None:
            sys.exit(_INTERRUPTED_STATUS)
        self.keeper.interrupt()


def main(arguments: list[str] | None = None) -> int:
    """Run a job to its end; 0 when it is Complete, 1 when it Failed.

    Raises SystemExit with status 143 when SIGTERM has interrupted it, 75 when Spark is gone, and
    with a sentence where the job can't be read.
    """
    parser = argparse.ArgumentParser(prog="bagpipe.driver", description=__doc__)
    parser.add_argument("--job", type=Path, required=True, help="the job.json of the operator")
    options = parser.parse_args(arguments)
    logging.basicConfig(level=logging.INFO, format="%(asctime)s %(name)s %(message)s")
    logging.getLogger("py4j").setLevel(logging.WARNING)
    job = job_of(options.job)
    progress = progress_of(job)
    metrics = DriverMetrics(progress, job)
    server = serve_progress(progress, metrics.registry, "0.0.0.0", PROGRESS_PORT)  # noqa: S104  the operator asks by the pod's address
    interruption = Interruption()
    signal.signal(signal.SIGTERM, interruption)
    try:
        complete = ended(progress, lambda: run(job, progress, interruption, metrics.count))
    finally:
        message = progress.termination_message()
        log.info("%s", message)
        if _TERMINATION_LOG.exists():
            _TERMINATION_LOG.write_text(message)
        server.shutdown()
    return 0 if complete else 1


def job_of(file: Path) -> JobFile:
    """The job that is to run; raises SystemExit with a sentence where an engine can't be used."""
    try:
        return JobFile.model_validate_json(file.read_bytes())
    except InstallationError as error:
        sys.exit(f"bagpipe.driver: {error}")


def progress_of(job: JobFile) -> Progress:
    """The account of one driver, which says whose it is: its address may be another's next."""
    slots = job.spec.spark.executors * job.spec.spark.slots
    return Progress(results_uri(job), slots=slots, uid=job.uid, attempt=job.attempt)


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


class Cluster:
    """Where a job's cases run: in executors of Kubernetes. Another place overrides this."""

    def __init__(self) -> None:
        self.seen = Seen()

    def planned(self, job: JobFile, storage: Storage) -> Plan:
        """The cases that are to run. Raises MatrixError and NoCaseError."""
        return plan(job.spec, storage)

    def run_cases(self, job: JobFile, cases: list[Case], keeper: Keeper) -> None:
        """Run the cases; their rows go to the keeper."""
        _run_cases(job, cases, keeper, self.seen)


def run(
    job: JobFile,
    progress: Progress,
    interruption: Interruption | None = None,
    counted: Callable[[Row], None] = lambda _row: None,
    place: Cluster | None = None,
) -> bool:
    """Plan, run what the journal does not have, and commit; True when the job is Complete.

    Raises CannotResumeError, StorageError, SparkGoneError, and SystemExit after an interruption.
    """
    place = place or Cluster()
    storage = Storage(job.volumes)
    results = Results(job, storage)
    journal = Journal(storage, results.folder, job.attempt)
    if manifest := results.committed():
        return _adopted(results, manifest, journal, progress)
    if wrong := faults(job.spec.evaluate):
        progress.fail("CriteriaInvalid", "; ".join(wrong))
        return False
    if job.spec.baseline is not None:
        check_baseline(job.spec.baseline.results, storage)
    patiently(partial(storage.check_put_once, results.folder), progress)
    planned = place.planned(job, storage)
    log.info("%d cases planned, %d bags refused", len(planned.cases), len(planned.unplanned))
    progress.begin(len(planned.cases) + len(planned.unplanned))
    with tempfile.TemporaryDirectory() as folder, RowFile(Path(folder, "rows")) as rows:
        keeper = Keeper(
            progress, rows, journal, job.spec.max_failed_cases, results.is_committed,
            counted=counted,
        )  # fmt: skip
        if interruption is not None:
            interruption.keeper = keeper
        if manifest := _taken_away(keeper, planned, results):
            return _adopted(results, manifest, journal, progress)
        if job.resume is not None:
            taken = keeper.take_over(passed_rows(job.resume, planned, storage))
            log.info("%d cases were taken over from job %s", taken, job.resume.job)
        _run_the_rest(place, job, planned, keeper)
        if keeper.interrupted:
            sys.exit(_INTERRUPTED_STATUS)
        if keeper.stop is not None:
            progress.stop(keeper.stop.reason, keeper.stop.message)
        if keeper.stop is not None and not keeper.stop.final:
            progress.finish()
            return _unfinished(results, journal, progress)
        keep_trying = partial(patiently, progress=progress)
        progress.compare(compared(job.spec, rows.rows, storage, keep_trying))
        commit = partial(results.commit, rows, progress, journal.driver, place.seen)
        manifest = patiently(commit, progress)
        ours = manifest["driver"] == journal.driver
        publish = partial(results.publish, manifest, rows.rows if ours else journal.rows, journal)
        patiently(publish, progress)
        progress.adopt(manifest)
    return progress.phase == "Complete"


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


def _run_the_rest(place: Cluster, job: JobFile, planned: Plan, keeper: Keeper) -> None:
    """Run the cases without a row; however that ends, the rows there are reach the journal."""
    left = [case for case in planned.cases if case.id not in keeper.rows]
    log.info("%d cases were done before, %d are to run", len(keeper.rows), len(left))
    try:
        if left and keeper.stop is None:
            place.run_cases(job, left, keeper)
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


def _run_cases(job: JobFile, cases: list[Case], keeper: Keeper, seen: Seen) -> None:
    pod = DriverPod(
        name=os.environ["BAGPIPE_POD_NAME"],
        namespace=os.environ["BAGPIPE_NAMESPACE"],
        address=os.environ["BAGPIPE_POD_IP"],
        has_archive=Path(CLASS_ARCHIVE).exists(),
    )
    settings = spark_settings(job, pod, len(cases))
    log.info("Spark settings: %s", json.dumps(settings, sort_keys=True))
    context = RunContext(
        job=f"{job.namespace}/{job.name}",
        spec=job.spec,
        volumes=job.volumes,
        results=results_uri(job),
    )
    spark = SparkContext(conf=SparkConf().setAll(list(settings.items())))
    try:
        with Looking(partial(pods_of, pod.namespace, job.uid), seen):
            run_cases(spark, cases, context, keeper)
    finally:
        spark.stop()


if __name__ == "__main__":
    sys.exit(main())
