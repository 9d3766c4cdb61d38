"""How far a job is: counted from rows, told as JSON to the operator and to the termination log."""

import json
import threading
from collections import Counter
from dataclasses import dataclass, field
from typing import Any, Literal

from bagpipe.plan.cases import Unplanned
from bagpipe.run.case_run import Row

Phase = Literal["Planning", "Running", "Complete", "Failed"]
MAX_FAILURES = 5
_MAX_MESSAGE = 300
_OUTCOMES = ("passed", "failed", "invalid", "errored")


@dataclass
class Progress:
    """Thread-safe counts of one job; the driver writes them, the HTTP server reads them."""

    results: str
    phase: Phase = "Planning"
    reason: str = "Planning"
    message: str = "reading the bags' indexes"
    slots: int = 1
    planned: int = 0
    running: int = 0
    verdict: str = ""
    _outcomes: Counter[str] = field(default_factory=Counter)
    _ledger: Counter[str] = field(default_factory=Counter)
    _failures: list[dict[str, str]] = field(default_factory=list)
    _lock: threading.Lock = field(default_factory=threading.Lock)

    def begin(self, planned: int, unplanned: list[Unplanned]) -> None:
        """The plan is made; bags without a case count as errored."""
        with self._lock:
            self.planned = planned + len(unplanned)
            self.phase, self.reason = "Running", "CasesRunning"
            self.message = f"{self.planned} cases planned"
            for bag in unplanned:
                self._outcomes["errored"] += 1
                self._fail(bag.id, bag.reason, bag.message)

    def add(self, row: Row) -> None:
        """Count one finished case."""
        with self._lock:
            self._outcomes[row["outcome"]] += 1
            self._outcomes["retried"] += row["attempts"] > 1
            if row["result"]:
                ledger = row["result"]["ledger"]
                for key in ("sent", "received", "dropped", "lead_in"):
                    self._ledger[key] += ledger[key]
            if row["outcome"] != "passed":
                self._fail(row["case"], row["reason"], row["message"])

    def set_running(self, tasks: int) -> None:
        """How many cases are running: Spark's count of tasks lags behind, ours of rows does not."""
        with self._lock:
            self.running = max(0, min(tasks, self.slots, self.planned - self._done()))

    def finish(self) -> bool:
        """Decide how the job ended; True when it is Complete."""
        with self._lock:
            self.running = 0
            errored = self._outcomes["errored"]
            done = self._done()
            if errored or done < self.planned or not done:
                self.phase, self.verdict = "Failed", ""
                self.reason, self.message = self._why_failed(errored, self.planned - done)
            else:
                self.phase, self.reason = "Complete", "AllCasesRan"
                self.verdict = self._verdict()
                self.message = f"{done} of {self.planned} cases ran, verdict {self.verdict}"
            return self.phase == "Complete"

    def fail(self, reason: str, message: str) -> None:
        """End the job for a fault of the whole, such as storage that can't be written."""
        with self._lock:
            self.phase, self.reason, self.running = "Failed", reason, 0
            self.message = message[: 2 * _MAX_MESSAGE]

    def snapshot(self) -> dict[str, Any]:
        """The JSON of /progress and of the termination message, well under 4 KiB."""
        with self._lock:
            counts = {outcome: self._outcomes[outcome] for outcome in (*_OUTCOMES, "retried")}
            return {
                "phase": self.phase,
                "reason": self.reason,
                "message": self.message,
                "cases": {"planned": self.planned, "running": self.running, **counts},
                "ledger": {
                    "sent": self._ledger["sent"],
                    "received": self._ledger["received"],
                    "dropped": self._ledger["dropped"],
                    "leadIn": self._ledger["lead_in"],
                },
                "verdict": self.verdict,
                "results": self.results,
                "failures": list(self._failures),
            }

    def termination_message(self) -> str:
        """The snapshot in at most 4,096 bytes: Kubernetes cuts more, and cut JSON tells nothing."""
        snapshot = self.snapshot()
        while len(text := json.dumps(snapshot)) > 4096 and snapshot["failures"]:
            snapshot["failures"].pop()
        return text

    def _done(self) -> int:
        return sum(self._outcomes[outcome] for outcome in _OUTCOMES)

    def _fail(self, case: str, reason: str, message: str) -> None:
        if len(self._failures) < MAX_FAILURES:
            failure = {"case": case[:100], "reason": reason, "message": message[:_MAX_MESSAGE]}
            self._failures.append(failure)

    def _why_failed(self, errored: int, missing: int) -> tuple[str, str]:
        if not self._failures:
            return "CasesMissing", f"{missing} of {self.planned} cases gave no result"
        reasons = {failure["reason"] for failure in self._failures}
        first = self._failures[0]
        reason = first["reason"] if len(reasons) == 1 else "CasesErrored"
        return reason, (
            f"{errored} of {self.planned} cases errored; {first['case']}:"
            f" {first['reason']}: {first['message']}"
        )

    def _verdict(self) -> str:
        if self._outcomes["failed"]:
            return "Failed"
        return "Invalid" if self._outcomes["invalid"] else "Passed"
