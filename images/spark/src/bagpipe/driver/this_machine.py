"""A job's driver on a machine without Kubernetes.

Everything is the driver of a pod but for where the cases run: in processes of this machine, or on
a local Spark. What that one serves as /progress goes to stdout here, a line of JSON for each look;
the log and the workers' words go to stderr.
"""

import argparse
import json
import logging
import os
import signal
import threading
from collections.abc import Sequence
from pathlib import Path
from typing import TextIO

from bagpipe.driver import cases_in_processes
from bagpipe.driver.chosen import check_named, chosen
from bagpipe.driver.job import Interruption, Place, ended, job_of, run
from bagpipe.driver.keep import Keeper
from bagpipe.driver.progress import Progress
from bagpipe.driver.results import results_uri
from bagpipe.plan.case import Case
from bagpipe.plan.made import Plan
from bagpipe.run.case_run import RunContext
from bagpipe.run.laptop import local_spec
from bagpipe.spec import JobFile

_LOOK_SECONDS = 0.5


class ThisMachine(Place):
    """Cases beside one agent with as many slots: in processes, or on a local Spark."""

    def __init__(self, shared: str, slots: int, wanted: Sequence[str], spark: bool) -> None:
        super().__init__()
        self._shared = shared
        self._slots = slots
        self._names = wanted
        self._spark = spark

    def with_all_named(self, planned: Plan) -> Plan:
        """The plan, which has each name that somebody wants. Raises NoCaseError."""
        check_named(planned, self._names)
        return planned

    def wanted(self, planned: Plan) -> Plan:
        """The job's cases, as far as somebody wants them."""
        return chosen(planned, self._names)

    def run_cases(self, job: JobFile, cases: list[Case], keeper: Keeper) -> None:
        """Run the cases; what ran them is gone when this returns."""
        threading.Thread(target=_load_what_publishes, name="load", daemon=True).start()
        context = RunContext(
            job=f"{job.namespace}/{job.name}",
            spec=local_spec(job.spec),
            volumes=job.volumes,
            results=results_uri(job),
            shared=self._shared,
        )
        if self._spark:
            # Who runs without it needs neither PySpark nor Java.
            from bagpipe.driver import local_spark  # noqa: PLC0415

            local_spark.run_cases(job, cases, context, self._slots, keeper)
        else:
            cases_in_processes.run_cases(cases, context, self._slots, keeper)


def _load_what_publishes() -> None:
    """What makes reports takes 0.1 s to import: before the first case that would be waited for."""
    from bagpipe.driver import artefacts  # noqa: F401, PLC0415


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


def main(stdout: TextIO, arguments: list[str] | None = None) -> int:
    """Run a job to its end, whose progress goes to `stdout`; 0 when it is Complete, 1 when Failed.

    Raises SystemExit with status 143 when SIGTERM has interrupted it.
    """
    parser = argparse.ArgumentParser(prog="bagpipe.driver.local", description=__doc__)
    parser.add_argument("--job", type=Path, required=True, help="the job as a JobFile")
    parser.add_argument("--shared", required=True, help="the folder of the agent's slots")
    parser.add_argument("--slots", type=int, required=True, help="how many slots it has")
    parser.add_argument("--spark", action="store_true", help="run the cases on a local Spark")
    parser.add_argument("--cases", action="append", default=[], help="a number, or names")
    options = parser.parse_args(arguments)
    logging.basicConfig(level=logging.INFO, format="%(asctime)s %(name)s %(message)s")
    job = job_of(options.job)
    progress = Progress(results_uri(job), slots=options.slots)
    interruption = Interruption()
    signal.signal(signal.SIGTERM, interruption)
    place = ThisMachine(options.shared, options.slots, options.cases, options.spark)
    with stdout, ProgressLines(progress, stdout):
        complete = ended(progress, lambda: run(job, progress, place, interruption))
    return 0 if complete else 1
