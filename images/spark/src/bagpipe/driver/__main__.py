"""`python -m bagpipe.driver --job /etc/bagpipe/job.json`: the driver pod's only process."""

import argparse
import json
import logging
import os
import signal
import sys
from collections.abc import Mapping
from contextlib import AbstractContextManager, nullcontext
from functools import partial
from pathlib import Path

from pyspark import SparkConf, SparkContext

from bagpipe.driver.cases_on_spark import run_cases
from bagpipe.driver.executor_removal import stop_with_executors
from bagpipe.driver.in_turn import work_in_turn
from bagpipe.driver.job import Interruption, Place, ended, job_of, run
from bagpipe.driver.keep import Keeper
from bagpipe.driver.kept_spark import KeptSpark, Settings
from bagpipe.driver.metrics import DriverMetrics
from bagpipe.driver.offers import Offers
from bagpipe.driver.own_claim import StillClaimed, claim_of
from bagpipe.driver.own_pods import Looking, pods_of
from bagpipe.driver.progress import Progress
from bagpipe.driver.progress_server import Account, serve_progress
from bagpipe.driver.results import results_uri
from bagpipe.driver.seat import Seat
from bagpipe.driver.spark_context import CLASS_ARCHIVE, DriverPod, spark_settings
from bagpipe.plan.case import Case
from bagpipe.run.case_run import RunContext
from bagpipe.spec import JobFile

PROGRESS_PORT = 8080
_TERMINATION_LOG = Path("/dev/termination-log")
# Copies of cases that have an answer are ended within this time, or the driver ends.
_SETTLE_SECONDS = 5.0

log = logging.getLogger("bagpipe.driver")


def main(arguments: list[str] | None = None) -> int:
    """Run a job to its end; 0 when it is Complete, 1 when it Failed.

    In a pool the driver then waits for further jobs, and the last one counts. Raises SystemExit
    with status 143 when SIGTERM has interrupted a job, 75 when Spark is gone, and with a sentence
    where the job can't be read.
    """
    parser = argparse.ArgumentParser(prog="bagpipe.driver", description=__doc__)
    parser.add_argument("--job", type=Path, required=True, help="the job.json of the operator")
    options = parser.parse_args(arguments)
    logging.basicConfig(level=logging.INFO, format="%(asctime)s %(name)s %(message)s")
    logging.getLogger("py4j").setLevel(logging.WARNING)
    driver = Driver(job_of(options.job), os.environ)
    signal.signal(signal.SIGTERM, driver.interruption)
    server = serve_progress(driver.account, "0.0.0.0", PROGRESS_PORT)  # noqa: S104  the operator asks by the pod's address
    try:
        driver.work()
    finally:
        server.shutdown()
    return 0 if driver.complete else 1


class Driver:
    """One pod's work: the job that the pod was made for, and those that come after it."""

    def __init__(self, job: JobFile, environment: Mapping[str, str]) -> None:
        self.job = job
        self.interruption = Interruption()
        self.complete = False
        self._spark = KeptSpark(_start_spark, partial(stop_with_executors, namespace=job.namespace))
        self._uid = environment.get("BAGPIPE_POD_UID", "")
        self._idle_seconds = float(environment.get("BAGPIPE_POOL_IDLE_SECONDS") or 0)
        self._look_up = partial(claim_of, job.namespace)
        self._seat = Seat(self._uid, job.namespace, self._idle_seconds, self._look_up)
        self._seat.begin(job)
        progress = progress_of(job)
        self._metrics = DriverMetrics(progress, job)
        self.account = Account(progress, self._metrics.registry)
        if self.waits:
            self.account.offered = Offers(self._seat).offered

    @property
    def waits(self) -> bool:
        """Whether it waits for further jobs."""
        return self._idle_seconds > 0

    def work(self) -> None:
        """Bring one job after the other to its end. Raises SystemExit."""
        try:
            work_in_turn(self._seat, self._work_on, self.interruption, self._leave)
        finally:
            self._spark.end()

    def _work_on(self, job: JobFile) -> bool:
        """Bring a job to its end; whether the driver may take another one."""
        if job is not self.job:
            self._show(job)
        progress, place = self.account.progress, Cluster(self._spark, self.job, self.waits)
        try:
            with self._claimed(job):
                self.complete = ended(
                    progress,
                    lambda: run(job, progress, place, self.interruption, self._metrics.count),
                )
        finally:
            message = progress.termination_message()
            log.info("%s", message)
            _leave_word(message)
        done = self.waits and self.complete and self._spark.settles(_SETTLE_SECONDS)
        return done and self._may_look_up(job)

    def _may_look_up(self, job: JobFile) -> bool:
        """Whether claims can be looked up at all; who can't would keep the next job waiting."""
        try:
            self._look_up(job.name)
        except OSError as error:
            log.warning(
                "this driver does not wait for another job, whose claim it can't look up: %s "
                "(where it is forbidden, pools.enabled of the chart bagpipe-namespace gives the "
                "right)",
                error,
            )
            return False
        return True

    def _show(self, job: JobFile) -> None:
        """What is served and left behind is of this job from here on."""
        log.info("the next job is %s/%s", job.namespace, job.name)
        # How the job before it ended is no account of this one, whatever ends the pod.
        _leave_word("")
        self.complete = False
        progress = progress_of(job)
        self._metrics = DriverMetrics(progress, job)
        self.account.progress, self.account.registry = progress, self._metrics.registry

    def _leave(self) -> None:
        """Who asks learns from the account that the job has ended."""
        self.account.progress.close()

    def _claimed(self, job: JobFile) -> AbstractContextManager[object]:
        if job is self.job:
            return nullcontext()  # its pods go with it
        return StillClaimed(job, self._uid, self._look_up)


def _leave_word(message: str) -> None:
    """What the pod's status says when its container has ended."""
    if _TERMINATION_LOG.exists():
        _TERMINATION_LOG.write_text(message)


def _start_spark(settings: Settings) -> SparkContext:
    log.info("Spark settings: %s", json.dumps(settings, sort_keys=True))
    return SparkContext(conf=SparkConf().setAll(list(settings.items())))


def progress_of(job: JobFile) -> Progress:
    """The account of one driver, which says whose it is: its address may be another's next."""
    slots = job.spec.spark.most_slots
    return Progress(results_uri(job), slots=slots, uid=job.uid, attempt=job.attempt)


class Cluster(Place):
    """In executors of Kubernetes, which have the labels of the job that the pod was made for."""

    def __init__(self, spark: KeptSpark, made_for: JobFile, stays: bool) -> None:
        super().__init__()
        self._spark, self._made_for, self._stays = spark, made_for, stays

    def run_cases(self, job: JobFile, cases: list[Case], keeper: Keeper) -> None:
        """Run the cases; unless it stays for another job, Spark is gone when this returns."""
        pod = DriverPod(
            name=os.environ["BAGPIPE_POD_NAME"],
            namespace=os.environ["BAGPIPE_NAMESPACE"],
            address=os.environ["BAGPIPE_POD_IP"],
            has_archive=Path(CLASS_ARCHIVE).exists(),
        )
        settings = spark_settings(job, pod, len(cases), self._stays)
        context = RunContext(
            job=f"{job.namespace}/{job.name}",
            spec=job.spec,
            volumes=job.volumes,
            results=results_uri(job),
            slots=job.spec.spark.slots,
        )
        try:
            with Looking(partial(pods_of, pod.namespace, self._made_for.uid), self.seen):
                run_cases(self._spark.of(settings), cases, context, keeper)
        finally:
            if not self._stays:
                self._spark.end()


if __name__ == "__main__":
    sys.exit(main())
