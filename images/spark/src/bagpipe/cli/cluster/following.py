"""Follows one job by a watch until it has ended, however often the connection breaks."""

import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Protocol

from bagpipe.cli.cluster.faults import ClusterError
from bagpipe.cli.cluster.hints import again
from bagpipe.cli.cluster.state import JobState, Json

# An API server that is upgraded is away for a minute; one that is away longer needs somebody.
PATIENCE_SECONDS = 120.0
_LONGEST_PAUSE_SECONDS = 10.0
_LONGEST_WATCH_SECONDS = 300.0


class Source(Protocol):
    """Where jobs are seen."""

    def job(self, name: str) -> Json:
        """The job as it is now. Raises ClusterError."""

    def changes(self, name: str, version: str, seconds: float) -> Iterator[tuple[str, Json]]:
        """(`ADDED`, `MODIFIED` or `DELETED`, job) since a version. Raises ClusterError."""


@dataclass(frozen=True)
class Times:
    """The clock of one who waits, in seconds."""

    monotonic: Callable[[], float] = time.monotonic
    pause: Callable[[float], None] = time.sleep


class TimedOutError(ClusterError):
    """The time that was allowed is over, and the job is not."""


def states(source: Source, name: str, seconds: float, times: Times) -> Iterator[JobState]:
    """Each state of a job that differs from the one before; the last one has ended.

    Raises TimedOutError after `seconds`, and ClusterError when the job is deleted, or replaced by
    another of its name, or nobody answers for PATIENCE_SECONDS.
    """
    deadline = times.monotonic() + seconds
    last: JobState | None = None
    silent_since: float | None = None
    pause = 1.0
    while True:
        try:
            for state in _looks(source, name, deadline, times):
                silent_since, pause = None, 1.0
                if last is not None and state.uid != last.uid:
                    raise _gone(state)
                if state != last:
                    last = state
                    yield state
                if state.ended:
                    return
        except ClusterError as error:
            if not error.passing:
                raise _gone(last) if error.status == 404 and last else error from None
            now = times.monotonic()
            silent_since = now if silent_since is None else silent_since
            if now - silent_since > PATIENCE_SECONDS:
                raise ClusterError(
                    f"{error.message}. It was asked for {PATIENCE_SECONDS:.0f} s; the job goes on"
                    " without us"
                ) from error
        left = deadline - times.monotonic()
        if left <= 0:
            raise TimedOutError(_still(name, last, seconds))
        times.pause(min(pause, left))
        pause = min(2 * pause, _LONGEST_PAUSE_SECONDS)


def _looks(source: Source, name: str, deadline: float, times: Times) -> Iterator[JobState]:
    """What one connection shows: the job as it is, and its changes while the connection lasts."""
    job = source.job(name)
    yield JobState.of(job)
    seconds = min(deadline - times.monotonic(), _LONGEST_WATCH_SECONDS)
    if seconds <= 0:
        return
    for kind, seen in source.changes(name, job["metadata"]["resourceVersion"], seconds):
        if kind == "DELETED":
            raise _gone(JobState.of(seen))
        yield JobState.of(seen)
        if times.monotonic() >= deadline:
            return


def _gone(state: JobState) -> ClusterError:
    left = f" Results that it has published are in {state.results}." if state.results else ""
    return ClusterError(f"job {state.name} was deleted before it had ended.{left}")


def _still(name: str, state: JobState | None, seconds: float) -> str:
    now = f"it is {state.phase}: {state.message}".rstrip(" :.") if state else "it was not seen"
    hint = again(f"watch {name}", state.namespace if state else None)
    return (
        f"job {name} has not ended within {seconds:g} s, and goes on in the cluster; {now}."
        f" Follow it with `{hint}`, or give a longer --timeout"
    )
