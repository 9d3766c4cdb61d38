"""Cases of a job on this machine: the same agent, player and judge as in an executor's pod."""

import dataclasses
import os
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path

from bagpipe.plan.case import Case
from bagpipe.run.case_run import Row
from bagpipe.run.master_ports import NoPortsError, master_ports
from bagpipe.run.with_parent import die_with_parent
from bagpipe.source.chosen import source_of
from bagpipe.source.planning import plan
from bagpipe.source.source import JobSource
from bagpipe.spec import SimulationJobSpec
from bagpipe.storage import Storage
from bagpipe.wire.session import InputFile

# A machine with much other work takes a minute to start a program.
_READY_SECONDS = 90.0
_ANSWER_SECONDS = 30.0
_END_SECONDS = 15.0


class ReplayError(Exception):
    """The case can't be run here; the sentence says what is missing."""


def agent_program(name: str) -> str | None:
    """The agent's path: on PATH, or beside the Python that runs this, where its wheel puts it."""
    return shutil.which(name) or shutil.which(name, path=str(Path(sys.executable).parent))


def local_spec(spec: SimulationJobSpec) -> SimulationJobSpec:
    """The job with one image, this machine: there is no container to choose."""
    variants = [variant.model_copy(update={"image": ""}) for variant in spec.variants]
    return spec.model_copy(update={"variants": variants})


def planned_case(row: Row, spec: SimulationJobSpec, storage: Storage) -> Case:
    """The case that a row describes, cut again from its own recording.

    Raises ReplayError where the recording has no such window (any more), StorageError where it
    can't be read.
    """
    uri = row.get("bag")
    source = source_of(spec).alone(uri) if uri and "window" in row else None
    if source is None:
        raise ReplayError(f"{row['case']} has no recording that could be played again")
    planned = plan(spec.model_copy(update={"source": source}), storage)
    for case in planned.cases:
        window = [case.window.lead_in_start, case.window.start, case.window.end]
        conditions = case.conditions
        planned_as = (conditions.variant, conditions.values, conditions.seed, conditions.round)
        wanted = (row["variant"], row["values"], row["seed"], row["round"])
        if window == row["window"] and planned_as == wanted:
            return dataclasses.replace(case, id=row["case"])
    why = "; ".join(bag.message for bag in planned.unplanned)
    raise ReplayError(
        f"{row['case']} can't be cut from {uri}: {why or 'it has no such window'}. Is it the"
        " recording that the job has played?"
    )


def write_fragment(case: Case, source: JobSource, storage: Storage, target: Path) -> Path:
    """The case's part of its recording, without an index, which the agent needs not.

    Its name is `target` with the ending of the recording's own.
    """
    made = source.input(case, storage)
    if not isinstance(made, InputFile):
        raise ReplayError(f"{case.id} has no recording that could be played again")
    written = target.with_suffix(Path(source.file_name(case)).suffix)
    with written.open("wb") as file:
        for piece in made.pieces():
            file.write(piece)
    return written


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


def _await_ready(agent: str, shared: Path, process: "subprocess.Popen[bytes]", log: Path) -> None:
    deadline = time.monotonic() + _READY_SECONDS
    while not _is_ready(agent, shared):
        if process.poll() is not None or time.monotonic() > deadline:
            last = log.read_text(errors="replace").strip().splitlines()[-5:]
            raise ReplayError(f"the agent did not start; it wrote: {' '.join(last) or 'nothing'}")


def _is_ready(agent: str, shared: Path) -> bool:
    # It looks every few milliseconds by itself; in between it is seen whether the agent has ended.
    ready = [agent, "ready", "--shared", str(shared), "--wait", "1"]
    try:
        done = subprocess.run(ready, capture_output=True, check=False, timeout=_ANSWER_SECONDS)
    except subprocess.TimeoutExpired:
        return False
    return done.returncode == 0


def own_environment() -> dict[str, str]:
    """Ours, without the virtual environment of this program: ROS has a Python of its own."""
    environment = dict(os.environ)
    if sys.prefix != sys.base_prefix:
        own = str(Path(sys.prefix, "bin"))
        parts = environment.get("PATH", os.defpath).split(os.pathsep)
        environment["PATH"] = os.pathsep.join(part for part in parts if part != own)
        environment.pop("VIRTUAL_ENV", None)
    return environment
