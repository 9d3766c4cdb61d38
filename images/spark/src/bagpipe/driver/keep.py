"""Keeping rows while Spark works: counted, journaled, and watched for a reason to stop.

Spark hands rows over as tasks end; a thread of the driver takes them from there. Faults
of storage are retried here, and Spark is stopped where a job can't go on.
"""

import logging
import threading
import time
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from typing import Any

from bagpipe.driver.journal import Journal
from bagpipe.driver.patience import PATIENCE_SECONDS
from bagpipe.driver.progress import Progress
from bagpipe.driver.row_file import RowFile
from bagpipe.plan.made import Plan
from bagpipe.quarantine import Quarantine
from bagpipe.row_facts import badness, quarantine_of
from bagpipe.run.case_run import Row, is_of, unplanned_row
from bagpipe.storage import StorageError

_LOOK_SECONDS = 0.5
_FENCE_SECONDS = 15.0
INTERRUPTED = "Interrupted"

log = logging.getLogger(__name__)


# So many rows of an earlier job are in memory.
_ROWS_AT_ONCE = 1_000


@dataclass(frozen=True)
class Stop:
    """Why no further case is to run; `reason` is CamelCase."""

    reason: str
    message: str
    # Whether the job's own cases are the reason, so that what was done is all there will be.
    final: bool = False


_INTERRUPTION = Stop(INTERRUPTED, "the driver's pod received SIGTERM")


def segment_seconds(elapsed: float) -> float:
    """How long rows may wait for a journal segment: 1 % of the job's time, from 1 to 30 s.

    So a driver that dies loses little of what was done, and a long job makes few segments.
    """
    return min(30.0, max(1.0, elapsed / 100))


def outcome_line(row: Row) -> str:
    """How a case ended, in the line of the driver's log that `bagpipe logs` looks for."""
    outcome = f"{row['outcome']} {row.get('reason') or ''}".strip()
    outcome += " (in quarantine)" if quarantine_of(row) else ""
    seconds = row.get("seconds") or 0.0
    return f"case {row['case']}: {outcome}, attempts {row['attempts']}, seconds {seconds:.1f}"


@dataclass
class Keeper:
    """Takes rows, each case's first one only, into progress, row file and journal."""

    progress: Progress
    rows: RowFile
    journal: Journal
    max_failed: int | None = None
    superseded: Callable[[], bool] = lambda: False
    clock: Callable[[], float] = time.monotonic
    stop: Stop | None = None
    counted: Callable[[Row], None] = lambda _row: None
    quarantine: Quarantine = field(default_factory=Quarantine)
    _unwritten: list[Row] = field(default_factory=list)
    _begun: float = -1.0
    _flushed: float = 0.0
    _failing_since: float | None = None
    _interrupted: bool = False
    _fenced: float = 0.0

    def resume(self, planned: Plan) -> None:
        """Take what earlier drivers journaled of this plan, and the bags that yield no case.

        A row counts only for the very case that was planned now: a bag that was replaced, or cut
        otherwise, is run again. Of several of one case, as drivers leave them that worked at once,
        the worst counts. Raises StorageError.
        """
        cases = {case.id: case for case in planned.cases}
        taken: dict[str, int] = {}
        for row in self.journal.rows():
            case = cases.get(row["case"])
            if case is None or not is_of(row, case) or badness(row) <= taken.get(case.id, -2):
                continue
            self.rows.replace(self.quarantine.marked(row))
            taken[case.id] = badness(row)
        for row in self.rows.rows():
            self.progress.add(row)
        self.take([unplanned_row(bag) for bag in planned.unplanned])

    def take(self, rows: list[Row]) -> None:
        """Count rows that tasks handed over; a case that has one already is not counted again."""
        for ended in rows:
            row = self.quarantine.marked(ended)
            if self.rows.add(row):
                self.progress.add(row)
                self.counted(row)
                log.info("%s", outcome_line(row))
                self._unwritten.append(row)
        if self.max_failed is not None and self.progress.failed() > self.max_failed:
            self._end(
                "TooManyFailedCases",
                f"{self.progress.failed()} cases failed or errored, spec.maxFailedCases is"
                f" {self.max_failed}: the others were not run",
                final=True,
            )

    def take_over(self, rows: Iterable[Row]) -> int:
        """Take an earlier job's rows; how many there are. They are journaled as this job's own."""
        before = len(self.rows)
        for row in rows:
            self.take([row])
            if len(self._unwritten) % _ROWS_AT_ONCE == 0:
                self._flush(self.clock())
        return len(self.rows) - before

    def look(self) -> None:
        """What is due now: a journal segment, a look for another driver's manifest."""
        now = self.clock()
        if self._begun < 0:
            self._begun = self._flushed = self._fenced = now
        if now - self._fenced >= _FENCE_SECONDS:
            self._fenced = now
            self._look_for_a_manifest()
        if self._unwritten and now - self._flushed >= segment_seconds(now - self._begun):
            self._flush(now)

    @property
    def interrupted(self) -> bool:
        """Whether the pod is being ended."""
        return self.stop is not None and self.stop.reason == INTERRUPTED

    def interrupt(self) -> None:
        """The pod is being ended: no further case is run, and what is done is journaled."""
        self._interrupted = True
        if self.stop is None:
            self.stop = _INTERRUPTION

    def finish(self, pause: threading.Event) -> None:
        """Journal what is left, waiting for storage as long as patience lasts.

        An interrupted driver tries once: its kubelet waits for no storage. Of what could not be
        kept nothing may be committed, so that a stop which was final is no more.
        """
        if self.interrupted and self._unwritten:
            self._flush(self.clock())
        while self._unwritten and (self.stop is None or self.stop.final):
            self._flush(self.clock())
            if self._unwritten and self._interrupted:
                self.stop = _INTERRUPTION
            elif self._unwritten:
                pause.wait(1.0)

    def _flush(self, now: float) -> None:
        self._flushed = now
        try:
            while self._unwritten:
                # What is kept is not written again, where a later segment fails.
                del self._unwritten[: self.journal.append(self._unwritten)]
        except StorageError as error:
            self._failing_since = now if self._failing_since is None else self._failing_since
            waited = now - self._failing_since
            log.warning("the journal can't be written for %.0f s: %s", waited, error)
            self.progress.warn(f"The results can't be kept at the moment: {error}")
            if waited >= PATIENCE_SECONDS:
                self._give_up(f"{error}; it was tried for {waited:.0f} s")
            return
        self._failing_since = None
        self.progress.warn("")

    def _look_for_a_manifest(self) -> None:
        try:
            if self.superseded():
                self._end("Superseded", "another driver of this job has committed its results")
        except StorageError as error:
            log.warning("could not look for another driver's manifest: %s", error)

    def _end(self, reason: str, message: str, final: bool = False) -> None:
        if self.stop is None:
            self.stop = Stop(reason, message, final)

    def _give_up(self, message: str) -> None:
        """The journal can't be kept, which ends the job also where its cases had stopped it.

        The message then names both. A stop that left the rest to another driver stays.
        """
        stopped = self.stop
        if stopped is not None and stopped.final:
            message = f"{message}. Before that, {stopped.reason}: {stopped.message}"
            self.stop = None
        self._end("StorageFailed", message)


class Keeping:
    """Runs a keeper beside Spark: `with Keeping(...)` around the Spark job.

    What goes wrong in the keeper itself cancels that job, and the block raises it.
    """

    def __init__(
        self,
        keeper: Keeper,
        new_rows: Callable[[], list[Row]],
        running: Callable[[], int],
        cancel: Callable[[], None],
    ) -> None:
        self._keeper = keeper
        self._new_rows = new_rows
        self._running = running
        self._cancel = cancel
        self._ended = threading.Event()
        self._error: Exception | None = None
        self._thread = threading.Thread(target=self._work, name="keeper", daemon=True)

    def __enter__(self) -> None:
        self._thread.start()

    def __exit__(self, *_error: Any) -> None:
        self._ended.set()
        self._thread.join()
        try:
            self._keeper.take(self._new_rows())
        finally:
            if self._error is not None:
                raise self._error

    def _work(self) -> None:
        try:
            while not self._ended.wait(_LOOK_SECONDS):
                self._look()
        except Exception as error:
            log.exception("the keeper failed: no further case is run")
            self._error = error
            self._cancel_until_ended()

    def _look(self) -> None:
        self._keeper.take(self._new_rows())
        self._keeper.look()
        self._keeper.progress.set_running(self._running())
        if self._keeper.stop is not None:
            if self._keeper.interrupted:
                self._keeper.finish(self._ended)
            # At each look: Spark's job may not have begun when it was cancelled first.
            self._cancel()

    def _cancel_until_ended(self) -> None:
        """Without a keeper a job would run on, its rows unwritten and its signals ignored."""
        while not self._ended.is_set():
            try:
                self._cancel()
            except Exception:  # where Spark is gone, its job ends of itself
                log.exception("the cases could not be cancelled")
            self._ended.wait(_LOOK_SECONDS)
