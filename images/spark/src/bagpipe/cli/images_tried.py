"""A job in the cluster for each image that a search looks at, and what its cases say of it."""

import contextlib
import copy
import fnmatch
import signal
import uuid
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from types import FrameType
from typing import Any, Protocol

from bagpipe.cli.cluster.faults import ClusterError
from bagpipe.cli.cluster.following import TimedOutError, Times, states
from bagpipe.cli.cluster.state import JobState
from bagpipe.cli.judged_step import Step, is_decided, of_round, of_rounds
from bagpipe.cli.places import RefusedError, results_at
from bagpipe.cli.running import Ending
from bagpipe.row_facts import OUTCOMES
from bagpipe.storage import StorageError

Json = dict[str, Any]

# What speaks of other jobs, or of cases that are not looked at, what would keep a job waiting, and
# who would be notified of a job that they have not asked for.
_LEFT_OUT = (
    "baseline", "comparison", "quarantine", "maxFailedCases", "notify", "resumeFrom", "suspend",
)  # fmt: skip
_LONGEST_NAME = 40
# Of six digits, as a spec's durations have at most.
_LONGEST_DEADLINE = 999_999


class Jobs(Protocol):
    """A namespace of a cluster."""

    def create(self, job: Json) -> Json:
        """The job as it was taken. Raises ClusterError."""

    def delete(self, name: str) -> None:
        """Delete a job, if it is there. Raises ClusterError."""

    def job(self, name: str) -> Json:
        """The job as it is now. Raises ClusterError."""

    def changes(self, name: str, version: str, seconds: float) -> Iterator[tuple[str, Json]]:
        """Its changes since a version. Raises ClusterError."""


@dataclass
class Tried:
    """An image, what its cases came to, and where the results of its rounds are."""

    image: str
    step: Step = field(default_factory=lambda: Step("unknown", "not looked at to its end"))
    results: list[str] = field(default_factory=list)

    def as_json(self) -> Json:
        """For --output json and yaml."""
        return {
            "image": self.image,
            "word": self.step.word,
            "why": self.step.why,
            "results": self.results,
        }


@dataclass(frozen=True)
class Trial:
    """How each image is looked at; `show` gets a line for each job that begins."""

    manifest: Mapping[str, Any]
    cases: Sequence[str]
    rounds: int
    seconds: float
    volumes: dict[str, str]
    jobs: Jobs
    show: Callable[[str], None] = lambda _text: None
    times: Times = field(default_factory=Times)

    def look(self, tried: Tried) -> None:
        """Run the rounds of an image; `tried` has what is known also where this is interrupted.

        No job is left when it returns or raises. Raises ClusterError where the cluster refuses a
        job: it would refuse those of the other images, too.
        """
        found: list[Step] = []
        with interruptible():
            for _ in range(self.rounds):
                found.append(self._round(tried))
                if is_decided(found):
                    break
        tried.step = of_rounds(found)

    def _round(self, tried: Tried) -> Step:
        job = job_of(self.manifest, tried.image, self.seconds)
        name = str(job["metadata"]["name"])
        try:
            self.show(f"{tried.image}: job {name}")
            with _undisturbed():
                self.jobs.create(job)
            return self._judged(name, tried)
        finally:
            with _undisturbed():
                self._delete(name)

    def _judged(self, name: str, tried: Tried) -> Step:
        last: JobState | None = None
        try:
            for state in states(self.jobs, name, self.seconds, self.times):
                last = state
        except TimedOutError:
            return Step("unknown", f"job {name} has not ended within {self.seconds:g} s")
        except ClusterError as error:
            return Step("unknown", error.message)
        if last is None or not last.results:
            why = f"{last.reason}: {last.message}" if last else "it was not seen"
            return Step("unknown", f"job {name} left no results: {why}")
        tried.results.append(last.results)
        return self._of_results(last)

    def _of_results(self, state: JobState) -> Step:
        try:
            stored = results_at(state.results, self.volumes)
            counts = stored.manifest()["counts"]
            rows = [row for row in stored.rows() if self._is_asked_for(str(row["case"]))]
        except (StorageError, RefusedError) as error:
            why = "" if state.verdict else f"{state.reason}: {state.message}; "
            return Step("unknown", f"{why}{error}")
        # Which cases gave no result no row says: it may be one that is asked for.
        missing = counts["planned"] - sum(counts[outcome] for outcome in OUTCOMES)
        return of_round(rows, len(rows) + missing, self.cases)

    def _is_asked_for(self, case: str) -> bool:
        return any(fnmatch.fnmatchcase(case, pattern) for pattern in self.cases)

    def _delete(self, name: str) -> None:
        try:
            self.jobs.delete(name)
        except ClusterError as error:
            self.show(f"job {name} is left in the cluster: {error.message}")


@contextlib.contextmanager
def _undisturbed() -> Iterator[None]:
    """Ctrl-C waits until one request to the cluster is over, which has a deadline of its own.

    A job whose creation was cut off might come to be after it was deleted.
    """
    with Ending() as ending:
        yield
    if ending.count:
        raise KeyboardInterrupt


@contextlib.contextmanager
def interruptible() -> Iterator[None]:
    """SIGTERM and SIGHUP are as Ctrl-C while this lasts: what was made is deleted then, too."""

    def interrupt(_number: int, _frame: FrameType | None) -> None:
        raise KeyboardInterrupt

    before = {number: signal.getsignal(number) for number in (signal.SIGTERM, signal.SIGHUP)}
    for number, handler in before.items():
        if handler != signal.SIG_IGN:
            signal.signal(number, interrupt)
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


def job_of(manifest: Mapping[str, Any], image: str, seconds: float) -> Json:
    """The job of one round: with this image, under a name that no other has.

    The name is chosen here, so that a job whose creation had no answer can be deleted. One that
    nobody deletes, since this process was killed, ends after as many `seconds` and goes after that.
    """
    job: Json = copy.deepcopy(dict(manifest))
    token = uuid.uuid4().hex[:8]
    name = str(job["metadata"].get("name") or job["metadata"].get("generateName") or "bisect")
    short = name[: _LONGEST_NAME - len(token) - 1].rstrip("-")
    job["metadata"].pop("generateName", None)
    job["metadata"]["name"] = f"{short}-{token}"
    for key in _LEFT_OUT:
        job["spec"].pop(key, None)
    # In a pool's pods a round would meet what the stack of the one before left there.
    if isinstance(job["spec"].get("spark"), dict):
        job["spec"]["spark"].pop("pool", None)
    if seconds <= _LONGEST_DEADLINE:
        job["spec"].setdefault("activeDeadline", f"{max(1, round(seconds))}s")
    job["spec"].setdefault("ttlAfterFinished", "1h")
    job["spec"]["stack"] = job["spec"]["stack"] | {"image": image}
    return job


def images_between(good: str, bad: str, listed: Sequence[str]) -> list[str]:
    """The images of the search, the good end first. Raises RefusedError for what is no order.

    `listed` are the images from the oldest to the newest; the ends may be among them.
    """
    if good == bad:
        raise RefusedError("--good and --bad are the same image: give two")
    twice = next((image for image in listed if list(listed).count(image) > 1), None)
    if twice is not None:
        raise RefusedError(f"--images has {twice} twice: write each image once, the oldest first")
    first = listed.index(good) if good in listed else -1
    last = listed.index(bad) if bad in listed else len(listed)
    if last <= first:
        raise RefusedError("--images has --bad before --good: write the oldest image first")
    return [good, *listed[first + 1 : last], bad]
