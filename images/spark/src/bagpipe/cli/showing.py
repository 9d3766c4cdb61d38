"""Where a job is, on stderr: a line that changes on a terminal, else one now and then."""

import time
from collections.abc import Callable

from rich.console import Console

from bagpipe.cli.pace import Pace, done_of, line
from bagpipe.cli.running import ENDED, ProgressReport
from bagpipe.cli.terminal import unstyled

_LINE_SECONDS = 5.0


class QuietConsole(Console):
    """One that nobody reads any more has nothing to show, and ends nothing: rich would exit with 1,
    which is a verdict."""

    def on_broken_pipe(self) -> None:
        self.quiet = True


class Showing:
    """Shows a driver's accounts while a block runs."""

    def __init__(
        self,
        console: Console,
        slots: int,
        spark: bool = False,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self._console = console
        self._clock = clock
        starting = "starting Spark and" if spark else "starting"
        self._first = f"{starting} {slots} {'slot' if slots == 1 else 'slots'}"
        self._pace = Pace()
        self._status = console.status(self._first)
        self._shown = ("", 0.0)

    def __enter__(self) -> "Showing":
        if self._console.is_terminal:
            self._status.start()
        else:
            self._console.print(self._first)
        return self

    def __exit__(self, *_error: object) -> None:
        self._status.stop()

    def show(self, progress: ProgressReport) -> None:
        """The driver's account of this moment."""
        now = self._clock()
        # Not while the results are written: the rate would fall, though every case is done.
        if progress["phase"] == "Running":
            self._pace.look(now, done_of(progress))
        text = line(progress, self._pace)
        if self._console.is_terminal:
            self._status.update(unstyled(text))
            return
        before, at = self._shown
        if text != before and (now - at >= _LINE_SECONDS or progress["phase"] in ENDED):
            self._shown = (text, now)
            self._console.print(unstyled(text), highlight=False, soft_wrap=True)
