"""The driver as it is, on a standalone Spark in place of Kubernetes, with an agent of the tests'.

Usage: driver_of_two_hosts.py JOB MASTER SHARED SECONDS. Only where Spark runs is another matter,
the agent's folder, how long a case must run to be called slow (`SECONDS` for a minute), and that a
copy of the straggler waits for its first start to have begun.
"""

import os
import sys
import time
from functools import partial
from pathlib import Path

from bagpipe.driver import __main__ as driver
from bagpipe.driver import cases_on_spark, job, spark_context
from bagpipe.driver.journal import Journal
from bagpipe.driver.spark_context import DriverPod
from bagpipe.plan.case import Case
from bagpipe.run.case_run import Row, RunContext, run_case
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


def in_their_order(case: Case, context: RunContext, starts: int = 1) -> Row:
    """As run_case, once the program of the first start has begun: on a busy machine that of its
    copy could overtake it.
    """
    first = Path(context.volumes["results"]).parent / "marks/first"
    while starts > 1 and case.id == "straggler" and not first.exists():
        time.sleep(0.05)
    return run_case(case, context, starts)


class PrintingJournal(Journal):
    """Says what is in it before it is removed."""

    def remove(self) -> None:
        """As the journal's own."""
        print("journaled:", *sorted(row["case"] for row in self.rows()), file=sys.stderr)
        super().remove()


vars(job)["Journal"] = PrintingJournal
vars(cases_on_spark)["run_case"] = in_their_order
vars(driver).update(
    PROGRESS_PORT=0,
    RunContext=partial(RunContext, shared=_shared),
    spark_settings=settings,
)
os.environ |= {
    "BAGPIPE_POD_NAME": "driver", "BAGPIPE_NAMESPACE": "lab", "BAGPIPE_POD_IP": "127.0.0.1",
}  # fmt: skip
sys.exit(driver.main(["--job", _job]))
