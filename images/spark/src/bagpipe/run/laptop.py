"""Cases of a job on this machine: the same agent, player and judge as in an executor's pod."""

import ctypes
import dataclasses
import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path

import bagpipe
from bagpipe.plan.bag_tail import read_tail
from bagpipe.plan.cases import Case, plan
from bagpipe.run.case_run import Row
from bagpipe.run.fragment_stream import fragment_file
from bagpipe.run.master_ports import NoPortsError, master_ports
from bagpipe.run.pieces import sequence_file
from bagpipe.spec import SimulationJobSpec
from bagpipe.storage import Storage

_READY_SECONDS = 20.0
_END_SECONDS = 15.0
_PR_SET_PDEATHSIG = 1


class ReplayError(Exception):
    """The case can't be run here; the sentence says what is missing."""


def local_spec(spec: SimulationJobSpec) -> SimulationJobSpec:
    """The job with one image, this machine: there is no container to choose."""
    variants = [variant.model_copy(update={"image": ""}) for variant in spec.variants]
    return spec.model_copy(update={"variants": variants})


def planned_case(row: Row, spec: SimulationJobSpec, storage: Storage) -> Case:
    """The case that a row tells of, cut anew from its own recording.

    Raises ReplayError where the recording has no such window (any more), StorageError where it
    can't be read.
    """
    uri = row.get("bag")
    if not spec.source.uris or spec.source.simulator or not uri or "window" not in row:
        raise ReplayError(f"{row['case']} has no recording that could be played again")
    planned = plan(_of_one(spec, uri), storage)
    for case in planned.cases:
        window = [case.window.lead_in_start, case.window.start, case.window.end]
        conditions = case.conditions
        told = (conditions.variant, conditions.values, conditions.seed, conditions.round)
        wanted = (row["variant"], row["values"], row["seed"], row["round"])
        if window == row["window"] and told == wanted:
            return dataclasses.replace(case, id=row["case"])
    why = "; ".join(bag.message for bag in planned.unplanned)
    raise ReplayError(
        f"{row['case']} can't be cut from {uri}: {why or 'it has no such window'}. Is it the"
        " recording that the job has played?"
    )


def _of_one(spec: SimulationJobSpec, uri: str) -> SimulationJobSpec:
    """The job with one recording alone; a sequence needs all of its."""
    if spec.source.sequence:
        return spec
    name = "bags" if spec.source.bags else "files"
    source = spec.source.model_copy(update={name: [uri]})
    return spec.model_copy(update={"source": source})


def write_fragment(case: Case, storage: Storage, target: Path) -> None:
    """The case's part of its recording as a bag (without an index, which the agent reads)."""
    made = sequence_file(case, storage, case.bag) if case.parts else fragment_file(case, storage)
    with target.open("wb") as file:
        for piece in made.pieces():
            file.write(piece)


def play_command(case: Case, spec: SimulationJobSpec, storage: Storage, bag: Path) -> list[str]:
    """How the agent alone plays the fragment into nodes that run already."""
    window = case.window
    start = max(0, window.lead_in_start - _begin(case, storage, bag)) / 1e9
    command = ["bagpipe-agent", "play", str(bag), "--start", f"{start:.9f}"]
    command += ["--duration", f"{(window.end - window.lead_in_start) / 1e9:.9f}"]
    if spec.source.topics:
        command += ["--topics", *spec.source.topics]
    if spec.playback.mode == "max":
        command += ["--immediate"]
    elif spec.playback.mode == "realtime":
        command += ["--rate", f"{spec.playback.rate:g}"]
    for step in spec.playback.steps:
        command += ["--step", f"{step.trigger}={step.answer}"]
    return command


def _begin(case: Case, storage: Storage, bag: Path) -> int:
    """The time of the written fragment's first message, in ns."""
    if case.parts:
        return bagpipe.MemoryBag.open(bag).start or 0
    file = storage.open(case.bag)
    starts = {offset for offset, _ in case.ranges}
    chunks = read_tail(file.read, file.size).chunks
    return min(chunk.start_time for chunk in chunks if chunk.offset in starts)


@contextmanager
def serving_agent(agent: str, shared: Path, log: Path, slots: int = 1) -> Iterator[None]:
    """A local agent with `slots` slots below `shared`; it is ended with the block.

    Raises ReplayError where it does not start.
    """
    with ExitStack() as held:
        try:
            port = held.enter_context(master_ports(slots))
        except NoPortsError as error:
            raise ReplayError(str(error)) from error
        with _serving(agent, shared, log, slots, port):
            yield


@contextmanager
def _serving(agent: str, shared: Path, log: Path, slots: int, port: int) -> Iterator[None]:
    command = [agent, "serve", "--shared", str(shared), "--slots", str(slots)]
    command += ["--master-port", str(port)]
    with log.open("wb") as output:
        try:
            process = subprocess.Popen(
                command,
                stdout=output,
                stderr=subprocess.STDOUT,
                env=own_environment(),
                start_new_session=True,
                preexec_fn=die_with_parent,  # noqa: PLW1509  one system call, before any thread
            )
        except OSError as error:
            raise ReplayError(f"{agent} can't be started: {error.strerror}") from error
    try:
        _await_ready(agent, shared, process, log)
        yield
    finally:
        process.send_signal(signal.SIGTERM)
        try:
            process.wait(timeout=_END_SECONDS)
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()


def die_with_parent() -> None:
    """In a new process: SIGTERM comes when its parent is gone, however that one ended."""
    ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, signal.SIGTERM)


def _await_ready(agent: str, shared: Path, process: "subprocess.Popen[bytes]", log: Path) -> None:
    deadline = time.monotonic() + _READY_SECONDS
    pause = threading.Event()
    ready = [agent, "ready", "--shared", str(shared)]
    while subprocess.run(ready, capture_output=True, check=False, timeout=10).returncode:
        if process.poll() is not None or time.monotonic() > deadline:
            last = log.read_text(errors="replace").strip().splitlines()[-5:]
            raise ReplayError(f"the agent did not start; it said: {' '.join(last) or 'nothing'}")
        pause.wait(0.05)


def own_environment() -> dict[str, str]:
    """Ours, without the virtual environment of this program: ROS has a Python of its own."""
    environment = dict(os.environ)
    if sys.prefix != sys.base_prefix:
        own = str(Path(sys.prefix, "bin"))
        parts = environment.get("PATH", os.defpath).split(os.pathsep)
        environment["PATH"] = os.pathsep.join(part for part in parts if part != own)
        environment.pop("VIRTUAL_ENV", None)
    return environment
