"""The processes of `bagpipe run`: an agent and a driver, both ended with this one."""

import json
import math
import os
import select
import signal
import tempfile
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from types import FrameType
from typing import Any

from bagpipe.cli.driver_process import Process, driver
from bagpipe.cli.pace import done_of
from bagpipe.run.laptop import serving_agent
from bagpipe.spec import JobFile

_GLANCE_SECONDS = 0.2
# A driver that was asked to end first cancels its cases, then a Spark, which takes seconds.
_END_SECONDS = 40.0
_SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
_LINE_BYTES = 1 << 20
# The phases of a driver's account after which there is no other, and the status with which it ends
# then. One that ends by an error has status 1 as well, with whatever account it gave last.
ENDED = {"Complete": 0, "Failed": 1}

ProgressReport = dict[str, Any]


class RunError(Exception):
    """The job can't be run here, or was interrupted; the sentence says what to do."""


class RunInterruptedError(RunError):
    """Ctrl-C or SIGTERM ended the run."""


class RunTooLongError(RunError):
    """The run's deadline ended it."""


@dataclass
class Ending:
    """Ctrl-C and SIGTERM while a block runs: counted, so that nothing is left behind by them."""

    count: int = 0
    # Of time.monotonic(): from here on the run is ended as by one of them.
    until: float = math.inf
    _before: dict[int, Any] = field(default_factory=dict)

    def __enter__(self) -> "Ending":
        # What is ignored stays so: nohup lets a run outlive its terminal.
        wanted = [number for number in _SIGNALS if signal.getsignal(number) != signal.SIG_IGN]
        self._before = {number: signal.signal(number, self._note) for number in wanted}
        return self

    def __exit__(self, *_error: object) -> None:
        for number, handler in self._before.items():
            signal.signal(number, handler)

    @property
    def late(self) -> bool:
        """Whether the deadline has passed."""
        return time.monotonic() > self.until

    def _note(self, _number: int, _frame: FrameType | None) -> None:
        self.count += 1


@dataclass(frozen=True)
class Driver:
    """How a job's driver is started: slots, names or a number of the wanted cases (none: all), and
    whether a local Spark runs them.
    """

    slots: int
    wanted: Sequence[str] = ()
    spark: bool = False

    def words(self, job: Path, shared: Path) -> list[str]:
        """Those of its command line."""
        words = ["--job", str(job), "--shared", str(shared), "--slots", str(self.slots)]
        words += ["--spark"] if self.spark else []
        return words + [f"--cases={word}" for word in self.wanted]


def run_here(
    job: JobFile,
    agent: str,
    wanted: Driver,
    logs: Path,
    show: Callable[[ProgressReport], None],
    seconds: float = math.inf,
) -> ProgressReport:
    """Run a job on this machine; `show` gets where it is, the last time when it has ended.

    The processes' words go to agent.log and driver.log in `logs`. Raises ReplayError where the
    agent does not start, RunInterruptedError, RunTooLongError after so many `seconds`, and RunError
    where the driver ends without an account.
    """
    ending = Ending(until=time.monotonic() + seconds)
    with tempfile.TemporaryDirectory(prefix="bagpipe-run-") as scratch, ending:
        shared, file = Path(scratch, "shared"), Path(scratch, "job.json")
        shared.mkdir()
        file.write_text(job.model_dump_json(by_alias=True))
        with (
            serving_agent(agent, shared, logs / "agent.log", wanted.slots),
            driver(wanted.words(file, shared), logs / "driver.log", _END_SECONDS) as process,
        ):
            progress = _followed(process, ending, show)
    unended = progress is None or progress["phase"] not in ENDED
    if ending.count and unended:
        done = _done(progress)
        raise RunInterruptedError(f"interrupted{done}; --resume goes on with the other cases")
    if ending.late and unended:
        raise RunTooLongError(f"not ended within {seconds:g} s{_done(progress)}")
    if progress is None or process.returncode != ENDED.get(progress["phase"]):
        raise RunError(_died(process.returncode, logs / "driver.log"))
    return progress


def _followed(
    driver: Process, ending: Ending, show: Callable[[ProgressReport], None]
) -> ProgressReport | None:
    """The driver's last report, once it has closed its stdout; None if there is none."""
    stream = driver.stdout
    assert stream is not None  # noqa: S101  it is a pipe
    rest, progress = b"", None
    asked_at: float | None = None
    while True:
        if select.select([stream], [], [], _GLANCE_SECONDS)[0]:
            data = os.read(stream.fileno(), _LINE_BYTES)
            if not data:
                return progress
            *lines, rest = (rest + data).split(b"\n")
            progress = json.loads(lines[-1]) if lines else progress
        if progress is not None:
            show(progress)
        if (ending.count or ending.late) and asked_at is None:
            asked_at = time.monotonic()
            driver.terminate()
        if asked_at and (ending.count > 1 or time.monotonic() - asked_at > _END_SECONDS):
            os.killpg(driver.pid, signal.SIGKILL)
            return progress


def _done(progress: ProgressReport | None) -> str:
    cases = progress["cases"]["planned"] if progress else 0
    return f" after {done_of(progress)} of {cases} cases" if progress and cases else ""


def _died(status: int, log: Path) -> str:
    last = log.read_text(errors="replace").strip().splitlines()[-5:]
    how = f"signal {-status}" if status < 0 else f"status {status}"
    return f"the driver ended with {how}; {log} says last: {' | '.join(last) or 'nothing'}"
