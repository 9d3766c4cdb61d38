"""`python -m bagpipe.driver --job /etc/bagpipe/job.json`: the driver pod's only process."""

import argparse
import json
import logging
import os
import sys
from pathlib import Path

from pyspark import SparkConf, SparkContext

from bagpipe.driver.progress import Progress
from bagpipe.driver.progress_server import serve_progress
from bagpipe.driver.results import commit, first_rows, results_uri
from bagpipe.driver.simulate import simulate
from bagpipe.driver.spark_context import DriverPod, spark_settings
from bagpipe.plan.cases import Plan, plan
from bagpipe.run.case_run import Row, RunContext
from bagpipe.spec import JobFile
from bagpipe.storage import Storage, StorageError

PROGRESS_PORT = 8080
_TERMINATION_LOG = Path("/dev/termination-log")

log = logging.getLogger("bagpipe.driver")


def main(arguments: list[str] | None = None) -> int:
    """Run a job to its end; 0 when it is Complete, 1 when it Failed."""
    parser = argparse.ArgumentParser(prog="bagpipe.driver", description=__doc__)
    parser.add_argument("--job", type=Path, required=True, help="the job.json of the operator")
    options = parser.parse_args(arguments)
    logging.basicConfig(level=logging.INFO, format="%(asctime)s %(name)s %(message)s")
    logging.getLogger("py4j").setLevel(logging.WARNING)
    job = JobFile.model_validate_json(options.job.read_bytes())
    progress = Progress(results_uri(job), slots=job.spec.spark.executors * job.spec.spark.slots)
    server = serve_progress(progress, "0.0.0.0", PROGRESS_PORT)  # noqa: S104  the operator asks by the pod's address
    try:
        complete = run(job, progress)
    except StorageError as error:
        progress.fail("StorageFailed", str(error))
        complete = False
    except Exception as error:  # the last word of a driver must be a reason
        log.exception("the driver failed")
        progress.fail("DriverFailed", f"{type(error).__name__}: {error}")
        complete = False
    finally:
        message = progress.termination_message()
        log.info("%s", message)
        if _TERMINATION_LOG.exists():
            _TERMINATION_LOG.write_text(message)
        server.shutdown()
    return 0 if complete else 1


def run(job: JobFile, progress: Progress) -> bool:
    """Plan, simulate and commit; True when the job is Complete."""
    storage = Storage(job.volumes)
    planned = plan(job.spec, storage)
    log.info("%d cases planned, %d bags refused", len(planned.cases), len(planned.unplanned))
    progress.begin(len(planned.cases), planned.unplanned)
    rows = first_rows(_rows(job, planned, progress)) if planned.cases else []
    complete = progress.finish()
    commit(job, rows, planned.unplanned, progress, storage)
    return complete


def _rows(job: JobFile, planned: Plan, progress: Progress) -> list[Row]:
    pod = DriverPod(
        name=os.environ["BAGPIPE_POD_NAME"],
        namespace=os.environ["BAGPIPE_NAMESPACE"],
        address=os.environ["BAGPIPE_POD_IP"],
    )
    settings = spark_settings(job, pod)
    log.info("Spark settings: %s", json.dumps(settings, sort_keys=True))
    context = RunContext(
        job=f"{job.namespace}/{job.name}",
        spec=job.spec,
        volumes=job.volumes,
        results=results_uri(job),
    )
    spark = SparkContext(conf=SparkConf().setAll(list(settings.items())))
    try:
        return simulate(spark, planned.cases, context, progress)
    finally:
        spark.stop()


if __name__ == "__main__":
    sys.exit(main())
