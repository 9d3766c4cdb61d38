"""A driver's process: real cases over a local Spark, whose metrics are served as a pod's own.

    driver_with_failures.py FOLDER NAMESPACE NAME=ADDRESS NAME=ADDRESS

Two jobs take turns until the process is killed, the first in real time, the second in lock-step.
Planner, workers, pipes, keeper and metrics are the real ones. The agent is the fake one at the
other end of the FIFOs: of six sessions one loses messages and one has a stack that crashes.
"""

import copy
import dataclasses
import itertools
import os
import select
import sys
import threading
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from pyspark import SparkConf, SparkContext

from bagpipe.driver.cases_on_spark import run_cases
from bagpipe.driver.journal import Journal
from bagpipe.driver.keep import Keeper
from bagpipe.driver.metrics import DriverMetrics
from bagpipe.driver.progress import Progress
from bagpipe.driver.progress_server import Account, serve_progress
from bagpipe.driver.row_file import RowFile
from bagpipe.driver.spark_context import QUICK_JVM
from bagpipe.plan.case import Case
from bagpipe.run.case_run import RunContext
from bagpipe.source.planning import plan
from bagpipe.spec import JobFile
from bagpipe.storage import Storage
from bagpipe.wire.frames import FrameType
from tests.unit.bagpipe.bags import steady, write_bag
from tests.unit.bagpipe.fake_agent import RESULT, FakeAgent, Script, aborting, make_slot
from tests.unit.bagpipe.jobs import make_job

PORT = 8080
BATCH = 4
PLANNED = 10_000  # more than there is time for: the jobs run as long as they are looked at
STEP = {"trigger": "/scan", "answer": "/out", "deadline": "2s"}


def result(number: int, lockstep: bool) -> dict[str, Any]:
    """What an agent reports; every sixth time in real time with a loss on a busy machine."""
    sent = copy.deepcopy(RESULT)
    if number % 6 == 2 and not lockstep:
        lost = {"received": 2, "dropped": 1, "waited_seconds": 1.0}
        sent["ledger"]["topics"][0]["subscribers"][0] |= lost
        stood = {"stall_max_seconds": 0.0, "late_max_seconds": 0.0}
        unknown = ("cpu_pressure_seconds", "throttled_seconds", "steal_seconds")
        busy = {"busy": True, "message": "others had the processors"}
        sent["machine"] = stood | dict.fromkeys(unknown) | busy
    parts = ("assemble", "master", "stack", "subscribe", "lead_in", "play")
    sent["timings"] |= dict.fromkeys(parts, 0.01)
    sent["playback"] |= {"achieved_rate": 0.97, "played_seconds": 0.2, "late_max_seconds": 0.004}
    if lockstep:
        step = {"triggers": ["/scan"], "answer": "/out", "by": "count"}
        answers = {"released": 5, "answered": 3, "no_output": 1, "skipped": 1, "unmatched": 0}
        waited = {"waited_seconds": 0.6, "slowest_seconds": 0.4}
        sent["playback"]["steps"] = [step | answers | waited]
    return sent


def playing(number: int) -> Script:
    """A session that takes a moment, as a replay does."""

    def script(agent: FakeAgent) -> None:
        agent.read_until(FrameType.END)
        case = agent.received[0].fields()["case"]
        outgoing = agent.open_outgoing()
        agent.greet(outgoing)
        threading.Event().wait(0.1)
        sent = result(number, case["playback"]["mode"] == "lockstep")
        agent.send(outgoing, FrameType.RESULT, sent)
        agent.send(outgoing, FrameType.FILE, {"name": "case.bag", "size": 0})
        digest = agent._encoder.digest
        agent.send(outgoing, FrameType.END, {"files": 1, "bytes": 0, "digest": digest})

    return script


def sessions() -> Iterator[Script]:
    """One script for each session, without an end."""
    for number in itertools.count():
        ends = {
            4: aborting("StackExited", "the stack ended", ["boom"]),
            5: aborting("NeverSubscribed", "nobody subscribed to /scan", []),
        }
        yield ends.get(number % 6) or playing(number)


class PatientAgent(FakeAgent):
    """Serves a script for each session, and waits while Spark starts its workers."""

    def __init__(self, folder: Path) -> None:
        super().__init__(folder)
        self._scripts = sessions()  # type: ignore[assignment]

    def start(self) -> None:
        """Serves until the end of the process."""
        self._thread.start()

    def _await_bytes(self) -> None:
        poll = select.poll()
        poll.register(self._incoming, select.POLLIN)
        assert poll.poll(120_000), "no worker within 120 s"


class ServedJob:
    """One job, with its metrics on an address of its own."""

    def __init__(self, folder: Path, job: JobFile, address: str, shared: Path) -> None:
        self.progress = Progress("pvc://results/out", slots=2)
        self.progress.begin(PLANNED)
        metrics = DriverMetrics(self.progress, job)
        serve_progress(Account(self.progress, metrics.registry), address, PORT)
        storage = Storage(job.volumes)
        uri = f"pvc://results/out/{job.name}"
        self.keeper = Keeper(
            self.progress, RowFile(folder / f"{job.name}-rows"), Journal(storage, uri, 1),
            counted=metrics.count,
        )  # fmt: skip
        self.context = RunContext(
            f"{job.namespace}/{job.name}", job.spec, job.volumes, uri, str(shared)
        )
        self.case = plan(job.spec, storage).cases[0]

    def batch(self, number: int) -> list[Case]:
        """Cases that no batch had before."""
        return [
            dataclasses.replace(self.case, id=f"case-{number}-{place}") for place in range(BATCH)
        ]


def main(folder: Path, namespace: str, *addresses: str) -> None:
    """Runs both jobs until the end of the process."""
    volumes = {name: str(folder / name) for name in ("recordings", "results")}
    for path in volumes.values():
        Path(path).mkdir()
    write_bag(Path(volumes["recordings"], "a.bag"), steady("/scan", 200, 10_000_000))
    shared = folder / "shared"
    agent = PatientAgent(make_slot(shared))
    playbacks: list[dict[str, Any]] = [{}, {"mode": "lockstep", "steps": [STEP]}]
    served = []
    for named, playback in zip(addresses, playbacks, strict=True):
        name, address = named.split("=")
        job = make_job(volumes, playback=playback)
        job = job.model_copy(update={"name": name, "namespace": namespace})
        served.append(ServedJob(folder, job, address, shared))
    os.environ["PYSPARK_PYTHON"] = sys.executable
    conf = SparkConf().setMaster("local[2, 9]").set("spark.ui.enabled", "false")
    conf.set("spark.driver.extraJavaOptions", QUICK_JVM)
    conf.set("spark.driver.host", "127.0.0.1").set("spark.driver.bindAddress", "127.0.0.1")
    spark = SparkContext(conf=conf)
    agent.start()
    for number in itertools.count():
        for each in served:
            run_cases(spark, each.batch(number), each.context, each.keeper)


if __name__ == "__main__":
    main(Path(sys.argv[1]), sys.argv[2], *sys.argv[3:])
