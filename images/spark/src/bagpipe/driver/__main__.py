"""`python -m bagpipe.driver --job /etc/bagpipe/job.json`: the driver pod's only process."""

import argparse
import json
import logging
import os
import signal
import sys
from functools import partial
from pathlib import Path

from pyspark import SparkConf, SparkContext

from bagpipe.driver.cases_on_spark import run_cases
from bagpipe.driver.job import Interruption, Place, ended, job_of, run
from bagpipe.driver.keep import Keeper
from bagpipe.driver.metrics import DriverMetrics
from bagpipe.driver.own_pods import Looking, pods_of
from bagpipe.driver.progress import Progress
from bagpipe.driver.progress_server import serve_progress
from bagpipe.driver.results import results_uri
from bagpipe.driver.spark_context import CLASS_ARCHIVE, DriverPod, spark_settings
from bagpipe.plan.case import Case
from bagpipe.run.case_run import RunContext
from bagpipe.spec import JobFile

PROGRESS_PORT = 8080
_TERMINATION_LOG = Path("/dev/termination-log")

log = logging.getLogger("bagpipe.driver")


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
        complete = ended(
            progress, lambda: run(job, progress, Cluster(), interruption, metrics.count)
        )
    finally:
        message = progress.termination_message()
        log.info("%s", message)
        if _TERMINATION_LOG.exists():
            _TERMINATION_LOG.write_text(message)
        server.shutdown()
    return 0 if complete else 1


def progress_of(job: JobFile) -> Progress:
    """The account of one driver, which says whose it is: its address may be another's next."""
    slots = job.spec.spark.most_slots
    return Progress(results_uri(job), slots=slots, uid=job.uid, attempt=job.attempt)


class Cluster(Place):
    """In executors of Kubernetes."""

    def run_cases(self, job: JobFile, cases: list[Case], keeper: Keeper) -> None:
        """Run the cases; Spark is gone when this returns."""
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
            with Looking(partial(pods_of, pod.namespace, job.uid), self.seen):
                run_cases(spark, cases, context, keeper)
        finally:
            spark.stop()


if __name__ == "__main__":
    sys.exit(main())
