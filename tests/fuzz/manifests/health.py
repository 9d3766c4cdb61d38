"""Whether the operator lives on while it is fuzzed: its process, its probe, its log, its faults."""

import re
import threading
from dataclasses import dataclass, field
from pathlib import Path

from tests.integration.control_plane.operator_process import OperatorProcess

# As the chart's liveness probe, but looked at more often: a kubelet would restart it after six.
LOOK_SECONDS = 1.0
# kopf logs an error too when it restarts a watch, as after each change of a CRD.
_TROUBLE = re.compile(
    r"^Traceback|unexpected fault"
    r"|^\S+ \S+ (ERROR|CRITICAL) (?!kopf\S+: Request attempt .*will retry)",
    re.MULTILINE,
)
# An excerpt of the log around the first trouble, in characters.
_BEFORE, _AFTER = 600, 6_000


class UnhealthyError(AssertionError):
    """The operator died, does not answer its probe, or met what nobody thought of."""


@dataclass
class Health:
    """Looks at one operator until it is stopped."""

    operator: OperatorProcess
    worst: str = ""
    looks: int = 0
    _over: threading.Event = field(default_factory=threading.Event)
    _read: int = 0

    def __post_init__(self) -> None:
        self._thread = threading.Thread(target=self._watch, daemon=True)
        self._thread.start()

    def stop(self) -> None:
        """Ends the looking."""
        self._over.set()
        self._thread.join(timeout=60)

    def look(self) -> None:
        """Asks the probe of life once, and keeps its first bad answer."""
        status, text = self.operator.ask("/livez")
        self.looks += 1
        if status != 200 and not self.worst:
            self.worst = f"{status or 'no answer'} {text}"

    def check(self) -> None:
        """Raises UnhealthyError for all that has happened since the last time."""
        if not self.operator.server.alive:
            raise UnhealthyError(f"the operator has ended:\n{self.operator.logged()[-_AFTER:]}")
        if self.worst:
            raise UnhealthyError(f"the probe of life failed: {self.worst}")
        self._read_log(self.operator.log)
        faults = self.operator.metric('bagpipe_reconciles_total{result="faulted"}')
        if faults != 0.0:
            raise UnhealthyError(f"{faults} reconciles met a fault, or /metrics does not answer")

    def summary(self) -> str:
        """How often the probe was asked, and what the operator takes by now."""
        memory = self.operator.metric("process_resident_memory_bytes") or 0.0
        return f"{self.looks} looks at /livez; the operator takes {memory / 2**20:.0f} MiB"

    def _read_log(self, log: Path) -> None:
        with log.open(errors="replace") as file:
            file.seek(self._read)
            new = file.read()
            self._read = file.tell()  # codespell:ignore tell
        found = _TROUBLE.search(new)
        if found:
            excerpt = new[max(0, found.start() - _BEFORE) : found.start() + _AFTER]
            raise UnhealthyError(f"the operator's log has an unexpected error:\n{excerpt}")

    def _watch(self) -> None:
        while not self._over.wait(LOOK_SECONDS):
            self.look()
