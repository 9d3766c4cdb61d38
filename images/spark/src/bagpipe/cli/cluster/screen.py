"""How a job's progress looks: one line per change, or one block that is redrawn."""

from dataclasses import dataclass

from rich.console import Group, RenderableType
from rich.progress_bar import ProgressBar
from rich.table import Table
from rich.text import Text

from bagpipe.cli.cluster.pace import Pace, rate_words, time_words
from bagpipe.cli.cluster.state import Counts, JobState
from bagpipe.cli.terminal import plain

_COLOURS = {"passed": "green", "failed": "red", "invalid": "yellow", "errored": "magenta"}
_PHASES = {"Complete": "green", "Failed": "red", "Suspended": "yellow"}
# Not shown: the job takes its ordinary way.
_ORDINARY = frozenset({"CasesRunning", "Planning", "DriverPending", "InProgress"})
_MOST_FAILURES = 3
# Of each, what is not 0; in a terminal's block the first ones always.
_ALWAYS = ("passed", "failed", "invalid", "errored", "running")
_WORDS = (*_ALWAYS, "regressed", "crashed", "lost", "quarantined", "discarded")


@dataclass(frozen=True)
class Seen:
    """A look at a job, when it was made, and since when it is watched; seconds of one clock."""

    state: JobState
    pace: Pace
    begun: float
    made: float


def line(seen: Seen, clock: str) -> str:
    """One line for a log; `clock` is the time of day."""
    state = seen.state
    parts = [f"{clock} {state.phase}"]
    if state.cases.planned:
        parts.append(f"{state.cases.done} of {state.cases.planned} cases: {_counts(state.cases)}")
    if not state.ended:
        parts += [word for word in (_speed(seen, seen.made),) if word]
    if state.ended or state.reason not in _ORDINARY:
        parts.append(plain(f"{state.reason}: {state.message}"))
    return "; ".join(parts)


def block(seen: Seen, now: float) -> RenderableType:
    """The block for a terminal at the second `now`."""
    state = seen.state
    head = Text(state.name, style="bold")
    head.append(f"  {state.phase}", style=_PHASES.get(state.phase, "cyan"))
    head.append(f"  in namespace {state.namespace}, watched for {time_words(now - seen.begun)}")
    lines: list[RenderableType] = [head]
    if state.cases.planned:
        lines += [_bar(state.cases), _coloured(state.cases)]
        if speed := _speed(seen, now):
            lines.append(Text(speed))
    if state.message:
        lines.append(Text(plain(f"{state.reason}: {state.message}"), style=_weight(state)))
    for failure in state.failures[-_MOST_FAILURES:]:
        text = f"{failure.get('case')}: {failure.get('reason')}: {failure.get('message')}"
        lines.append(Text(f"  {plain(text)}", style="red", overflow="ellipsis", no_wrap=True))
    return Group(*lines)


def _bar(cases: Counts) -> RenderableType:
    row = Table.grid(padding=(0, 1))
    share = Text(f"{100 * cases.done // cases.planned} %")
    row.add_row(
        ProgressBar(total=cases.planned, completed=cases.done, width=40, complete_style="cyan"),
        share,
        Text(f"{cases.done} of {cases.planned} cases"),
    )
    return row


def _counts(cases: Counts) -> str:
    counts = [f"{getattr(cases, word)} {word}" for word in _WORDS if getattr(cases, word)]
    return ", ".join(counts) or "none has ended"


def _coloured(cases: Counts) -> Text:
    text = Text()
    for word in _WORDS:
        count = getattr(cases, word)
        if not count and word not in _ALWAYS:
            continue
        style = _COLOURS.get(word, "") if count else "dim"
        text.append(f"{'  ' if len(text) else ''}{word} {count}", style=style)
    return text


def _speed(seen: Seen, now: float) -> str:
    if seen.state.ended or seen.state.phase != "Running":
        return ""
    words = [rate_words(seen.pace.per_second(now))]
    if left := time_words(seen.pace.seconds_left(now, seen.state.cases)):
        words.append(f"about {left} left")
    return ", ".join(word for word in words if word)


def _weight(state: JobState) -> str:
    if state.ended:
        return "bold"
    return "" if state.reason in _ORDINARY else "yellow"
