"""`python -m bagpipe.driver.local`: a job's driver on a machine without Kubernetes.

`bagpipe run` starts it beside an agent. Spark's executor is this process' own JVM; everything else
is the driver of a pod. What that one serves as /progress goes to stdout here, a line of JSON for
each look; the log, Spark's and the workers' words go to stderr.
"""

import argparse
import json
import logging
import os
import signal
import subprocess
import sys
import threading
from collections.abc import Sequence
from pathlib import Path
from typing import TextIO

from pyspark import SparkConf, SparkContext
from pyspark.java_gateway import launch_gateway

from bagpipe.driver.__main__ import Cluster, Interruption, ended, job_of, run
from bagpipe.driver.cases_on_spark import run_cases
from bagpipe.driver.chosen import chosen
from bagpipe.driver.keep import Keeper
from bagpipe.driver.progress import Progress
from bagpipe.driver.results import results_uri
from bagpipe.driver.spark_context import local_settings
from bagpipe.plan.case import Case
from bagpipe.plan.made import Plan
from bagpipe.run.case_run import RunContext
from bagpipe.run.laptop import local_spec
from bagpipe.spec import JobFile
from bagpipe.storage import Storage

_LOOK_SECONDS = 0.5
_JVM_SECONDS = 20.0

log = logging.getLogger("bagpipe.driver")


class ThisMachine(Cluster):
    """Cases in Python workers of a local Spark, beside one agent with as many slots."""

    def __init__(self, shared: str, slots: int, wanted: Sequence[str]) -> None:
        super().__init__()
        self._shared = shared
        self._slots = slots
        self._wanted = wanted

    def planned(self, job: JobFile, storage: Storage) -> Plan:
        """The job's cases, as far as they are wanted."""
        return chosen(super().planned(job, storage), self._wanted)

    def run_cases(self, job: JobFile, cases: list[Case], keeper: Keeper) -> None:
        """Run the cases; Spark is gone when this returns."""
        # Spark's workers are to be this very Python, whatever PATH says.
        os.environ["PYSPARK_PYTHON"] = sys.executable
        # Nothing of Spark is to be reached from outside, whatever this machine's name means.
        os.environ["SPARK_LOCAL_IP"] = "127.0.0.1"
        conf = SparkConf().setAll(list(local_settings(job, self._slots).items()))
        context = RunContext(
            job=f"{job.namespace}/{job.name}",
            spec=local_spec(job.spec),
            volumes=job.volumes,
            results=results_uri(job),
            shared=self._shared,
        )
        gateway = launch_gateway(conf)  # type: ignore[no-untyped-call]
        try:
            spark = SparkContext(conf=conf, gateway=gateway)
            try:
                run_cases(spark, cases, context, keeper)
            finally:
                spark.stop()
        finally:
            gateway.shutdown()
            _end(gateway.proc)


def _end(jvm: "subprocess.Popen[bytes]") -> None:
    """The JVM ends, and removes its folders, when nobody holds its stdin."""
    if jvm.stdin is not None:
        jvm.stdin.close()
    try:
        jvm.wait(timeout=_JVM_SECONDS)
    except subprocess.TimeoutExpired:
        log.warning("Spark's JVM did not end within %.0f s: killed", _JVM_SECONDS)
        jvm.kill()
        jvm.wait()


class ProgressLines:
    """Writes the job's progress to a stream, twice a second and at the end of the `with` block."""

    def __init__(self, progress: Progress, stream: TextIO) -> None:
        self._progress = progress
        self._stream = stream
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self._work, name="progress-lines", daemon=True)

    def __enter__(self) -> None:
        self._thread.start()

    def __exit__(self, *_error: object) -> None:
        self._ended.set()
        self._thread.join()
        self._write()

    def _work(self) -> None:
        while self._write() and not self._ended.wait(_LOOK_SECONDS):
            pass

    def _write(self) -> bool:
        try:
            self._stream.write(json.dumps(self._progress.snapshot()) + "\n")
            self._stream.flush()
        except BrokenPipeError:
            # Who asked for this job is gone, and nobody else will end it.
            if not self._ended.is_set():
                os.kill(os.getpid(), signal.SIGTERM)
            return False
        return True


def main(arguments: list[str] | None = None) -> int:
    """Run a job to its end; 0 when it is Complete, 1 when it Failed.

    Raises SystemExit with status 143 when SIGTERM has interrupted it.
    """
    parser = argparse.ArgumentParser(prog="bagpipe.driver.local", description=__doc__)
    parser.add_argument("--job", type=Path, required=True, help="the job as a JobFile")
    parser.add_argument("--shared", required=True, help="the folder of the agent's slots")
    parser.add_argument("--slots", type=int, required=True, help="how many slots it has")
    parser.add_argument("--cases", action="append", default=[], help="a number, or names")
    options = parser.parse_args(arguments)
    logging.basicConfig(level=logging.INFO, format="%(asctime)s %(name)s %(message)s")
    logging.getLogger("py4j").setLevel(logging.WARNING)
    job = job_of(options.job)
    progress = Progress(results_uri(job), slots=options.slots)
    interruption = Interruption()
    signal.signal(signal.SIGTERM, interruption)
    place = ThisMachine(options.shared, options.slots, options.cases)
    with _own_stdout() as stdout, ProgressLines(progress, stdout):
        complete = ended(progress, lambda: run(job, progress, interruption, place=place))
    return 0 if complete else 1


def _own_stdout() -> TextIO:
    """Stdout for this module alone: what Spark and its children write there goes to stderr."""
    stdout = os.fdopen(os.dup(sys.stdout.fileno()), "w")
    os.dup2(sys.stderr.fileno(), sys.stdout.fileno())
    return stdout


if __name__ == "__main__":
    sys.exit(main())
