"""What the machine did while a test ran, seen by the test and not by the agent."""

import os
import threading
import time
from pathlib import Path
from types import TracebackType
from typing import Self

_LOOK_SECONDS = 0.02
# The agent's own thresholds, halved: whoever looks at other moments sees other figures.
_LATE_SECONDS = 0.025
_TAKEN = 0.025
_USED = 0.5


class Witness:
    """Looks 50 times a second, as long as the block lasts, whether somebody had the processors."""

    def __init__(self) -> None:
        self.late = 0.0
        self._over = threading.Event()
        self._thread = threading.Thread(target=self._look)
        self._begun = self._ended = (0.0, 0.0, 0.0)

    def __enter__(self) -> Self:
        self._begun = _processors()
        self._thread.start()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        fault: BaseException | None,
        at: TracebackType | None,
    ) -> None:
        self._over.set()
        self._thread.join()
        self._ended = _processors()

    @property
    def was_disturbed(self) -> bool:
        """Whether a thread woke late, or the processors were taken away or in use."""
        used, taken, seconds = (b - a for a, b in zip(self._begun, self._ended, strict=True))
        return self.late >= _LATE_SECONDS or taken >= _TAKEN * seconds or used >= _USED * seconds

    def _look(self) -> None:
        due = time.monotonic() + _LOOK_SECONDS
        while not self._over.wait(_LOOK_SECONDS):
            now = time.monotonic()
            self.late = max(self.late, now - due)
            due = now + _LOOK_SECONDS


def _processors() -> tuple[float, float, float]:
    """Seconds of all processors: in use, taken by the hypervisor, and all there were."""
    words = Path("/proc/stat").read_text().splitlines()[0].split()[1:9]
    user, nice, system, idle, waiting, irq, soft, steal = (
        int(word) / os.sysconf("SC_CLK_TCK") for word in words
    )
    used = user + nice + system + irq + soft
    return used, steal, used + idle + waiting + steal
