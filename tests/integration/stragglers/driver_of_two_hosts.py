"""The driver as it is, on a standalone Spark in place of Kubernetes, with an agent of the tests'.

Usage: driver_of_two_hosts.py JOB MASTER SHARED SECONDS. Only where Spark runs is another matter,
the agent's folder, and how long a case must run to be called slow (`SECONDS` for a minute).
"""

import os
import sys
from functools import partial

from bagpipe.driver import __main__ as driver
from bagpipe.driver import job, spark_context
from bagpipe.driver.journal import Journal
from bagpipe.driver.spark_context import DriverPod
from bagpipe.run.case_run import RunContext
from bagpipe.spec import JobFile

_job, _master, _shared, _seconds = sys.argv[1:]


def settings(of: JobFile, pod: DriverPod, cases: int, stays: bool) -> dict[str, str]:
    """The job's own settings, less Kubernetes."""
    made = spark_context.spark_settings(of, pod, cases, stays) | {
        "spark.master": _master,
        "spark.cores.max": str(of.spec.spark.most_slots),
        # Only Spark's Kubernetes backend makes the secret by itself.
        "spark.authenticate": "false",
        "spark.network.crypto.enabled": "false",
        "spark.speculation.minTaskRuntime": f"{_seconds}s",
        "spark.speculation.task.duration.threshold": f"{_seconds}s",
    }
    if of.spec.spark.is_elastic:
        made["spark.dynamicAllocation.executorIdleTimeout"] = "1s"
    return {key: value for key, value in made.items() if not key.startswith("spark.kubernetes.")}


class PrintingJournal(Journal):
    """Says what is in it before it is removed."""

    def remove(self) -> None:
        """As the journal's own."""
        print("journaled:", *sorted(row["case"] for row in self.rows()), file=sys.stderr)
        super().remove()


vars(job)["Journal"] = PrintingJournal
vars(driver).update(
    PROGRESS_PORT=0,
    RunContext=partial(RunContext, shared=_shared),
    spark_settings=settings,
)
os.environ |= {
    "BAGPIPE_POD_NAME": "driver", "BAGPIPE_NAMESPACE": "lab", "BAGPIPE_POD_IP": "127.0.0.1",
}  # fmt: skip
sys.exit(driver.main(["--job", _job]))
