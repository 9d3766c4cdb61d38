"""How far a job is: counted from rows, reported as JSON to the operator and the termination log."""

import dataclasses
import json
import threading
import time
from collections import Counter
from dataclasses import dataclass, field
from typing import Any, Literal

from bagpipe.driver.comparing import Compared, in_short
from bagpipe.driver.verdict import MOST_WHY, verdict_of
from bagpipe.plan.made import Selection
from bagpipe.quarantine import Quarantine, QuarantineTally, remarks
from bagpipe.row_facts import (
    OUTCOMES,
    TALLIES,
    counts_of,
    further_starts,
    quarantine_of,
    quarantine_words,
    tally,
)
from bagpipe.run.case_run import Row

Phase = Literal["Planning", "Running", "Complete", "Failed"]
MAX_FAILURES = 5
_MAX_MESSAGE = 300
# Of the first error, which the job's own message quotes: the operator takes 1,000 letters.
_MAX_FIRST = 800
_MAX_QUARANTINE = 300


@dataclass
class Progress:
    """Thread-safe counts of one job; the driver writes them, the HTTP server reads them."""

    results: str
    phase: Phase = "Planning"
    reason: str = "Planning"
    message: str = "reading the bags' indexes"
    warning: str = ""
    slots: int = 1
    uid: str = ""
    attempt: int = 0
    planned: int = 0
    running: int = 0
    verdict: str = ""
    verdict_reason: str = ""
    # Seconds since 1970: when this driver began, and when it first saw the job at its end.
    began: float = field(default_factory=time.time)
    ended: float | None = None
    # Whether the driver has done with the job and waits for another one.
    is_closed: bool = False
    _outcomes: Counter[str] = field(default_factory=Counter)
    # Of the cases that are not in quarantine.
    _counting: Counter[str] = field(default_factory=Counter)
    _quarantine: QuarantineTally = field(default_factory=lambda: QuarantineTally(Quarantine()))
    _ledger: Counter[str] = field(default_factory=Counter)
    _failures: list[dict[str, str]] = field(default_factory=list)
    _quarantined: list[dict[str, str]] = field(default_factory=list)
    # Of what errored and counts: the first case with its words, and at most two reasons.
    _first_error: str = ""
    # Cases that came to their end on a start that was not their first.
    _further: int = 0
    _error_reasons: set[str] = field(default_factory=set)
    _compared: Compared = field(default_factory=Compared)
    _selection: Selection | None = None
    _stopped: tuple[str, str] | None = None
    _lock: threading.Lock = field(default_factory=threading.Lock)

    def begin(self, planned: int) -> None:
        """The plan is made; `planned` counts bags that yield no case too."""
        with self._lock:
            self.planned = planned
            self.phase, self.reason = "Running", "CasesRunning"
            self.message = f"{self.planned} cases planned"

    def warn(self, message: str) -> None:
        """Report a trouble that may pass; an empty message when it has."""
        with self._lock:
            self.warning = shortened(message, _MAX_MESSAGE)

    def failed(self) -> int:
        """Cases that failed or errored so far, and count."""
        with self._lock:
            return self._counting["failed"] + self._counting["errored"]

    def left(self) -> int:
        """Cases that have not ended."""
        with self._lock:
            return max(0, self.planned - self._done())

    def look_at(self, quarantine: Quarantine) -> None:
        """By which rules the rows to come are in quarantine; they are marked when they come."""
        with self._lock:
            self._quarantine = QuarantineTally(quarantine)

    def select(self, selection: Selection) -> None:
        """By which of a catalogue's rows the cases were planned."""
        with self._lock:
            self._selection = selection

    @property
    def selection(self) -> dict[str, Any] | None:
        """The same, as provenance has it."""
        with self._lock:
            return dataclasses.asdict(self._selection) if self._selection else None

    @property
    def quarantine(self) -> dict[str, Any] | None:
        """The rules and what became of their cases, as the manifest has them."""
        with self._lock:
            return self._quarantine.as_json()

    def adopt(self, manifest: dict[str, Any]) -> None:
        """Report what another driver of this job has committed."""
        with self._lock:
            self.phase, self.verdict = manifest["phase"], manifest["verdict"]
            self.reason, self.message = manifest["reason"], manifest["message"]
            counts, ledger = counts_of(manifest), manifest["ledger"]
            self.planned, self.running = counts["planned"], 0
            self._outcomes = Counter({key: counts[key] for key in TALLIES})
            self._ledger = Counter(
                sent=ledger["sent"], received=ledger["received"],
                dropped=ledger["dropped"], lead_in=ledger["leadIn"],
            )  # fmt: skip
            self._failures, self._quarantined = list(manifest["failures"]), []
            self.verdict_reason = manifest.get("verdictReason", "")
            self._compared = Compared(manifest.get("comparisons") or [])

    def add(self, row: Row) -> None:
        """Count one finished case."""
        with self._lock:
            self._outcomes.update(tally(row))
            self._quarantine.add(row)
            self._further += further_starts(row) > 0
            self._counting[row["outcome"]] += quarantine_of(row) is None
            ledger = (row["result"] or {}).get("ledger")
            if ledger:
                for key in ("sent", "received", "dropped", "lead_in"):
                    self._ledger[key] += ledger[key]
            if row["outcome"] != "passed":
                self._fail(row)

    def set_running(self, tasks: int) -> None:
        """How many cases are running: Spark's count of tasks lags behind, ours of rows does not."""
        with self._lock:
            self.running = max(0, min(tasks, self.slots, self.planned - self._done()))

    def finish(self) -> bool:
        """Decide how the job ended; True when it is Complete."""
        with self._lock:
            self.running, self.warning = 0, ""
            self.ended = self.ended or time.time()
            errored = self._counting["errored"]
            done = self._done()
            if self._stopped is not None:
                self.phase, self.verdict, self.verdict_reason = "Failed", "", ""
                self.reason, self.message = self._stopped
            elif errored or done < self.planned or not done:
                self.phase, self.verdict, self.verdict_reason = "Failed", "", ""
                self.reason, self.message = self._why_failed(errored, self.planned - done)
            else:
                self.phase, self.reason = "Complete", "AllCasesRan"
                found = verdict_of(self._counting, self._compared)
                self.verdict, self.verdict_reason = found.word, found.reason
                self.message = f"{done} of {self.planned} cases ran, verdict {self.verdict}"
                note = f"; {self._compared.note}" if self._compared.note else ""
                self.message += f"{found.why}{note[:MOST_WHY]}{self._of_quarantine()}"
                self.message += self._of_further_starts()
            return self.phase == "Complete"

    def stop(self, reason: str, message: str) -> None:
        """No further case is run; `finish` says so."""
        with self._lock:
            self._stopped = (reason, shortened(message, 2 * _MAX_MESSAGE))

    def compare(self, compared: Compared) -> None:
        """What the comparisons with a baseline say, which `finish` looks at."""
        with self._lock:
            self._compared = compared

    @property
    def comparisons(self) -> list[dict[str, Any]]:
        """All that they say, as comparison.json has it."""
        return self._compared.found

    def interrupt(self) -> None:
        """The pod is being ended: the job has not, and another driver may go on."""
        with self._lock:
            self.running, self.reason = 0, "Interrupted"
            self.message = "the driver's pod received SIGTERM; what is done is in the journal"

    def lose(self, message: str) -> None:
        """Spark is gone: the job has not ended, and another driver may go on."""
        with self._lock:
            self.running, self.reason, self.message = 0, "SparkGone", message

    def close(self) -> None:
        """The job has ended, and its driver has not: who asks learns the end from the account."""
        with self._lock:
            self.is_closed = True

    def fail(self, reason: str, message: str) -> None:
        """End the job for a fault of the whole, such as storage that can't be written."""
        with self._lock:
            self.phase, self.reason, self.running = "Failed", reason, 0
            # What was decided counts only once it is committed.
            self.verdict, self.verdict_reason = "", ""
            self.message = shortened(message, 2 * _MAX_MESSAGE)

    def snapshot(self) -> dict[str, Any]:
        """The JSON of /progress and of the termination message, well under 4 KiB."""
        with self._lock:
            counts = {word: self._outcomes[word] for word in TALLIES}
            comparisons = [in_short(found) for found in self._compared.found]
            counts["regressed"] = sum(one["regressed"] for one in comparisons)
            return {
                "uid": self.uid,
                "attempt": self.attempt,
                "phase": self.phase,
                "ended": self.is_closed,
                "reason": self.reason,
                "message": self.message,
                "warning": self.warning,
                "cases": {"planned": self.planned, "running": self.running, **counts},
                "ledger": {
                    "sent": self._ledger["sent"],
                    "received": self._ledger["received"],
                    "dropped": self._ledger["dropped"],
                    "leadIn": self._ledger["lead_in"],
                },
                "verdict": self.verdict,
                "verdictReason": self.verdict_reason,
                "results": self.results,
                "failures": (self._failures + self._quarantined)[:MAX_FAILURES],
                "comparisons": comparisons,
            }

    def termination_message(self) -> str:
        """The snapshot in at most 4,096 bytes: Kubernetes cuts more, and cut JSON can't be read."""
        snapshot = self.snapshot()
        for part in ("failures", "comparisons"):
            while len(text := json.dumps(snapshot)) > 4096 and snapshot[part]:
                snapshot[part].pop()
        for part in ("warning", "message"):
            while len(text := json.dumps(snapshot)) > 4096 and snapshot[part]:
                snapshot[part] = shortened(snapshot[part], len(snapshot[part]) // 2)
        return text

    def _done(self) -> int:
        return sum(self._outcomes[outcome] for outcome in OUTCOMES)

    def _fail(self, row: Row) -> None:
        """Keep what a few cases say; those that count go before those in quarantine."""
        message, kept = row["message"], self._failures
        if words := quarantine_words(row):
            message, kept = f"{message} ({words})", self._quarantined
        elif row["outcome"] == "errored" and len(self._error_reasons) < 2:
            named = f"{row['case'][:100]}: {row['reason']}"
            self._first_error = self._first_error or f"{named}: {shortened(message, _MAX_FIRST)}"
            self._error_reasons.add(row["reason"])
        if len(kept) < MAX_FAILURES:
            short = shortened(message, _MAX_MESSAGE)
            kept.append({"case": row["case"][:100], "reason": row["reason"], "message": short})

    def _of_quarantine(self) -> str:
        """What of it belongs into the job's sentence: nobody may take these cases for passed."""
        document = self._quarantine.as_json()
        inside = self._done() - self._counting.total()
        words = [f"{self._outcomes['quarantined']} of {inside} cases in quarantine did not pass"]
        words = (words if inside else []) + remarks(document)
        return f"; {shortened('; '.join(words), _MAX_QUARANTINE)}" if words else ""

    def _of_further_starts(self) -> str:
        """A stack that hangs now and then may pass in the copy of a slow case: it must be seen."""
        return f"; {self._further} ended on a further start (`starts`)" if self._further else ""

    def _why_failed(self, errored: int, missing: int) -> tuple[str, str]:
        if not errored:
            return "CasesMissing", f"{missing} of {self.planned} cases gave no result"
        [*reasons] = self._error_reasons
        reason = reasons[0] if len(reasons) == 1 else "CasesErrored"
        return reason, f"{errored} of {self.planned} cases errored; {self._first_error}"


def shortened(message: str, most: int) -> str:
    """A message in at most that many letters, with its beginning and its end.

    A message begins with what went wrong and ends with what to do; lists are in the middle.
    """
    if len(message) <= most or most < 20:
        return message[:most]
    end = most // 3
    return f"{message[: most - end - 5]} ... {message[-end:]}"
