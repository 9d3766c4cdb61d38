"""Cases in processes of this machine: one for each slot, replaced when it ends with a case.

They are what Spark's Python workers are on a cluster: a case whose process is killed is started
again, and is given up after as many starts as there.
"""

import gc
import logging
import os
import socket
import sys
import threading
import time
import traceback
from collections import deque
from collections.abc import Callable, Sequence
from multiprocessing import reduction
from multiprocessing.connection import Connection
from typing import Any

from bagpipe.driver import slot_server
from bagpipe.driver.keep import Keeper, Keeping
from bagpipe.plan.case import Case
from bagpipe.run.attempts import QUARANTINE_ATTEMPT
from bagpipe.run.case_run import Row, RunContext, lost_row, run_case
from bagpipe.run.ran_on import ran_on
from bagpipe.run.with_parent import die_when_closed

_END_SECONDS = 10.0
_MOST_CHARACTERS = 1000

# A case's row; the last is how often it was started, this time included.
Run = Callable[[Case, RunContext, int], Row]

log = logging.getLogger(__name__)


def run_cases(
    cases: Sequence[Case],
    context: RunContext,
    slots: int,
    keeper: Keeper,
    run: Run = run_case,
) -> None:
    """Run all cases, each by `run`; their rows go to the keeper, which may end the work early.

    No process of a slot is left when this returns.
    """
    pool = _Pool(cases, lambda: _Worker(context, run), min(slots, len(cases)))
    with Keeping(keeper, pool.new_rows, pool.running, pool.cancel):
        pool.run()


class _Streams:
    """The driver's stderr, for a process that is forked off a server which has another."""

    def __reduce__(self) -> tuple[Callable[[object], object], tuple[object]]:
        return _take_over, (reduction.DupFd(sys.stderr.fileno()),)


def _take_over(streams: Any) -> None:
    descriptor = streams.detach()
    for number in (1, 2):
        os.dup2(descriptor, number)
    os.close(descriptor)


def _serve(
    connection: Connection, driver: Connection, context: RunContext, run: Run, _streams: _Streams
) -> None:
    """A process' life: cases with their numbers of starts come, rows or errors go."""
    die_when_closed(driver.fileno())
    gc.freeze()
    answer: tuple[Row | None, str]
    while True:
        try:
            case, starts = connection.recv()
        except EOFError:
            return
        try:
            answer = run(case, context, starts) | {"ran_on": ran_on()}, ""
        except Exception:
            # The case is tried again, and its row will have this.
            log.exception("%s", case.id)
            answer = None, traceback.format_exc()
        connection.send(answer)


class _Worker:
    """A process for one case after the other."""

    def __init__(self, context: RunContext, run: Run) -> None:
        forks = slot_server.forks()
        self._connection, theirs = forks.Pipe()
        # Its parent is the server, which lives as long as it does: so a pipe that we alone hold.
        driver, self._held = forks.Pipe(duplex=False)
        self._process = forks.Process(
            target=_serve, args=(theirs, driver, context, run, _Streams()), daemon=True
        )
        self._process.start()
        theirs.close()
        driver.close()

    def run(self, case: Case, starts: int) -> tuple[Row | None, str]:
        """The case's row; without one, what became of the process or of the case."""
        try:
            self._connection.send((case, starts))
            row, error = self._connection.recv()
        except (EOFError, OSError):
            self._process.join(_END_SECONDS)
            return None, f"its process ended with {_how(self._process.exitcode)}"
        return row, error

    def kill(self) -> None:
        """Ends it, with the case that it runs. May be called by another thread."""
        self._process.kill()

    def end(self) -> None:
        """Waits until it has ended."""
        self._connection.close()
        self._process.join(_END_SECONDS)
        if self._process.is_alive():
            self._process.kill()
            self._process.join()
        # Only now: what ends by itself is not to be ended by a signal.
        self._held.close()


def _how(status: int | None) -> str:
    if status is not None and status < 0:
        return f"signal {-status}"
    return f"status {status}"


class _Pool:
    """Threads that each lead one process through the cases that are left."""

    def __init__(self, cases: Sequence[Case], started: Callable[[], _Worker], slots: int) -> None:
        self._started = started
        self._slots = slots
        self._lock = threading.Lock()
        self._left = deque(cases)
        self._rows: list[Row] = []
        self._busy: list[_Worker] = []
        self._cancelled = False
        self._error: Exception | None = None

    def run(self) -> None:
        """Returns when all cases have rows, or the work was cancelled."""
        threads = [
            threading.Thread(target=self._lead, name=f"slot-{slot}") for slot in range(self._slots)
        ]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
        if self._error is not None:
            raise self._error

    def new_rows(self) -> list[Row]:
        """Rows since the last call."""
        with self._lock:
            rows, self._rows = self._rows, []
            return rows

    def running(self) -> int:
        """How many cases run."""
        with self._lock:
            return len(self._busy)

    def cancel(self) -> None:
        """Ends what runs; no further case is begun."""
        with self._lock:
            self._cancelled = True
            for worker in self._busy:
                worker.kill()

    def _lead(self) -> None:
        worker: _Worker | None = None
        try:
            while (case := self._next()) is not None:
                worker, row = self._run(worker, case)
                if row is not None:
                    with self._lock:
                        self._rows.append(row)
        except Exception as error:
            log.exception("a slot's thread failed: no further case is run")
            self._error = error
            self.cancel()
        finally:
            if worker is not None:
                worker.end()

    def _next(self) -> Case | None:
        with self._lock:
            return self._left.popleft() if self._left and not self._cancelled else None

    def _run(self, worker: _Worker | None, case: Case) -> tuple[_Worker | None, Row | None]:
        """The process that is left, and the case's row, if it was not cancelled."""
        lost: list[dict[str, Any]] = []
        while len(lost) < QUARANTINE_ATTEMPT:
            if self._cancelled:
                return worker, None
            worker = worker or self._started()
            begun = time.monotonic()
            if not self._begin(worker):
                return worker, None
            row, error = worker.run(case, len(lost) + 1)
            with self._lock:
                self._busy.remove(worker)
            if row is not None:
                return worker, row
            # Another process: what this one has left behind is not known.
            worker.kill()
            worker.end()
            worker = None
            lost.append(
                {
                    "executor": "driver",
                    "host": socket.gethostname(),
                    "seconds": round(time.monotonic() - begun, 3),
                    "error": error[-_MOST_CHARACTERS:],
                }
            )
        return None, lost_row(case, len(lost)) | {"evidence": {"starts": lost}}

    def _begin(self, worker: _Worker) -> bool:
        with self._lock:
            if not self._cancelled:
                self._busy.append(worker)
            return not self._cancelled
