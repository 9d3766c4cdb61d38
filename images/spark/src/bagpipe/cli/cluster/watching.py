"""Shows a job while it runs, and says at its end what became of it and where to look."""

import contextlib
import time
from collections.abc import Iterator
from dataclasses import asdict
from datetime import UTC, datetime

import click
from rich.console import Console
from rich.live import Live

from bagpipe.cli.cluster.following import Source, Times, states
from bagpipe.cli.cluster.hints import again
from bagpipe.cli.cluster.pace import Pace
from bagpipe.cli.cluster.screen import Seen, block, line
from bagpipe.cli.cluster.state import JobState
from bagpipe.cli.places import RefusedError
from bagpipe.cli.terminal import unstyled
from bagpipe.row_facts import verdict_words
from bagpipe.texts import duration_seconds

_PER_SECOND = 4
# A shell's status of a program that Ctrl-C ended: neither passed nor failed.
_INTERRUPTED = 130


class Seconds(click.ParamType[float]):
    """A length of time such as 30s, 20m or 4h."""

    name = "duration"

    def convert(
        self, value: object, param: click.Parameter | None, ctx: click.Context | None
    ) -> float:
        """The seconds."""
        try:
            return duration_seconds(str(value))
        except ValueError as error:
            self.fail(str(error), param, ctx)


timeout_option = click.option(
    "--timeout",
    type=Seconds(),
    default="24h",
    show_default=True,
    help="How long it is waited; the job itself goes on.",
)


class Watcher:
    """Draws what it is shown: a block in a terminal, else a line per change."""

    def __init__(self, console: Console, times: Times) -> None:
        self._console = console
        self._times = times
        self._pace = Pace()
        self._begun = times.monotonic()
        self._seen: Seen | None = None
        self._line = ""

    def show(self, state: JobState) -> None:
        """The next state of the job."""
        now = self._times.monotonic()
        if state.first_case is not None:
            ago = (datetime.now(UTC) - state.first_case).total_seconds()
            self._pace.began(now - max(0.0, ago))
            self._pace.look(now, state.cases.done)
        self._seen = Seen(state, self._pace, self._begun, now)
        if not self._console.is_terminal:
            self._print_line(self._seen)

    @contextlib.contextmanager
    def drawing(self) -> Iterator[None]:
        """While this lasts the block is redrawn, also when nothing changes but the time."""
        if not self._console.is_terminal:
            yield
            return
        with Live(
            get_renderable=lambda: block(self._seen, self._times.monotonic()) if self._seen else "",
            console=self._console,
            refresh_per_second=_PER_SECOND,
        ):
            yield

    def _print_line(self, seen: Seen) -> None:
        clock = datetime.now().astimezone().strftime("%H:%M:%S")
        text = line(seen, "")
        if text != self._line:  # what changed may be something that no line says
            self._line = text
            self._console.print(unstyled(clock + text), highlight=False, soft_wrap=True)


def followed(source: Source, name: str, seconds: float, console: Console) -> JobState:
    """Shows a job until it has ended; its last state. Raises ClusterError."""
    times = Times(time.monotonic, time.sleep)
    watcher = Watcher(console, times)
    last: JobState | None = None
    try:
        with watcher.drawing():
            for state in states(source, name, seconds, times):
                watcher.show(state)
                last = state
    except KeyboardInterrupt:
        hint = again(f"watch {name}", last.namespace if last else None)
        click.echo(f"no longer watched; job {name} goes on: {hint}", err=True)
        raise SystemExit(_INTERRUPTED) from None
    if last is None:
        raise RefusedError(f"job {name} was not seen")
    return last


def show_end(state: JobState, console: Console) -> None:
    """What became of a job, and what can be done next."""
    colour = {"Passed": "green", "Invalid": "yellow"}.get(state.verdict, "red")
    why = state.message if state.verdict else f"{state.reason}: {state.message}"
    words = verdict_words(state.verdict, asdict(state.cases))
    console.print(
        f"[bold {colour}]{unstyled(words)}[/]  {unstyled(f'{state.name}: {why}')}",
        highlight=False,
        soft_wrap=True,
    )
    for found in state.comparisons:
        counts = ", ".join(f"{found.get(w, 0)} {w}" for w in ("regressed", "fixed", "flaky"))
        name = found.get("variant") or "this job"
        console.print(unstyled(f"{name} is {found.get('verdict')}: {counts}"), highlight=False)
    if state.results:
        console.print(unstyled(f"results: {state.results}"), highlight=False, soft_wrap=True)
    hint = ""
    if not state.verdict:
        hint = again(f"logs {state.name}", state.namespace)
    elif state.verdict != "Passed":
        hint = again(f"results job/{state.name}", state.namespace, "--failed")
    if hint:
        console.print(unstyled(f"why: {hint}"), highlight=False, soft_wrap=True)
