"""What looks at something from time to time while a block runs."""

import threading
from collections.abc import Callable
from typing import Self


class Beside:
    """A thread that looks every so many seconds until the `with` block ends."""

    def __init__(self, name: str, every_seconds: float, look: Callable[[], bool]) -> None:
        """`look` says whether to look again. For what it raises the thread ends."""
        self._every_seconds, self._look = every_seconds, look
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self._work, name=name, daemon=True)

    def __enter__(self) -> Self:
        self._thread.start()
        return self

    def __exit__(self, *_error: object) -> None:
        self._ended.set()
        self._thread.join()

    @property
    def is_over(self) -> bool:
        """Whether the block has ended."""
        return self._ended.is_set()

    def _work(self) -> None:
        while not self._ended.wait(self._every_seconds) and self._look():
            pass
