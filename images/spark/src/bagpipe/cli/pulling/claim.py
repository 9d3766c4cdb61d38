"""Results on a claim, through a pod that is there for as long as they are copied."""

import contextlib
import json
import signal
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from types import FrameType
from typing import NoReturn

from bagpipe.cli.cluster.faults import ClusterError
from bagpipe.cli.cluster.hints import in_context
from bagpipe.cli.cluster.pods import Pods
from bagpipe.cli.cluster.state import Json
from bagpipe.cli.pulling.entry import Entry, PullError
from bagpipe.cli.pulling.exec_stream import ExecStream
from bagpipe.cli.pulling.pod import COMMAND, CONTAINER, MOUNT, Claimed, end_of, runs, waits_for
from bagpipe.cli.pulling.receiving import read_list, received
from bagpipe.cli.terminal import plain

# What is done with the pod; the client opens the connection as a GET, newer servers want create.
RIGHTS = (
    ("create", "pods"), ("get", "pods"), ("delete", "pods"), ("get", "pods/exec"),
    ("create", "pods/exec"),
)  # fmt: skip
_PIECE_BYTES = 1 << 20
# A list of many files on a slow volume comes at once, after a while.
_SILENT_SECONDS = 180.0
_LOOK_SECONDS = 0.5
_REMOVALS = 3
_ENDING = (signal.SIGTERM, signal.SIGHUP)

_HELD = ("Multi-Attach", "ReadWriteOncePod", "already in use", "already used")

Say = Callable[[str], None]


@dataclass(frozen=True)
class Limits:
    """Seconds for a pod to start, and for all of a pull."""

    start: float
    whole: float


class ClaimFolder:
    """A results folder that a pod sees, read by a program in it. Every method raises PullError."""

    def __init__(self, stream: ExecStream) -> None:
        self._stream = stream

    def listed(self) -> tuple[list[Entry], list[str]]:
        """The files that can be copied, and the names of what can't."""
        return read_list(self._stream)

    def sent(self, wanted: Sequence[Entry]) -> Iterator[tuple[Entry, Iterator[bytes]]]:
        """Each wanted file with its pieces; once."""
        names = json.dumps([entry.name for entry in wanted])
        self._stream.write(names.encode() + b"\n")
        yield from received(self._stream, wanted, _PIECE_BYTES)
        self._stream.end()


def check_rights(pods: Pods) -> None:
    """Raises PullError with all that the user may not do, before there is a pod to leave behind."""
    lacking = pods.refused_rights(RIGHTS)
    if lacking:
        verb, resource = lacking[0].split(" ")
        namespace = pods.cluster.namespace
        raise PullError(
            f"results on a claim are copied through a pod, and you may not {', '.join(lacking)} in"
            f" namespace {namespace}: `kubectl auth can-i {verb} {resource} -n {namespace}"
            f"{in_context()}` says whether you may; docs/tasks/ci-gate.md has a Role to ask for"
        )


@contextlib.contextmanager
def claim_folder(
    pods: Pods, manifest: Json, where: Claimed, limits: Limits, say: Say
) -> Iterator[ClaimFolder]:
    """The folder while a pod shows it; the pod is removed however the block ends.

    Raises PullError, and ClusterError where the API server refuses.
    """
    until = time.monotonic() + limits.whole
    with made_pod(pods, manifest, say) as name:
        await_running(pods, name, min(limits.start, limits.whole), say)
        folder = f"{MOUNT}/{where.folder}"
        socket = pods.exec(name, CONTAINER, [*COMMAND, folder])
        stream = ExecStream(socket, _SILENT_SECONDS, until)
        try:
            yield ClaimFolder(stream)
        except PullError as error:
            if ended := _end(pods, name):
                raise PullError(f"{error.message}; its pod ended: {plain(ended)}") from error
            raise
        finally:
            stream.close()


@contextlib.contextmanager
def made_pod(pods: Pods, manifest: Json, say: Say) -> Iterator[str]:
    """A pod's name while there is the pod. It is removed on errors, Ctrl-C and SIGTERM, too."""
    name = str(manifest["metadata"]["name"])
    with _signals(_ENDING, _end_by):
        there = True
        try:
            with _later((*_ENDING, signal.SIGINT)):
                try:
                    pods.create(manifest)
                except ClusterError as error:
                    # An answer that was lost may have been a yes.
                    there = error.passing
                    raise
            yield name
        finally:
            if there:
                with _signals((*_ENDING, signal.SIGINT), signal.SIG_IGN):
                    _remove(pods, manifest, say)


def await_running(pods: Pods, name: str, seconds: float, say: Say) -> None:
    """Until the pod's container runs. Raises PullError, with what keeps it from that."""
    until = time.monotonic() + seconds
    why = last = ""
    while time.monotonic() < until:
        pod = _looked_at(pods, name)
        if pod and runs(pod):
            return
        if pod and (ended := end_of(pod)):
            raise PullError(f"pod {name} ended before it could send anything: {plain(ended)}")
        why = waits_for(pod) or pods.warning(name) or why
        if why and why != last:
            say(f"pod {name} waits: {plain(why)}")
            last = why
        time.sleep(_LOOK_SECONDS)
    held = (
        ". A volume that another pod holds is free when that pod has ended"
        if any(word in why for word in _HELD)
        else ""
    )
    reason = plain(why) or "neither its status nor an event says why"
    raise PullError(f"pod {name} did not start within {seconds:g} s: {reason}{held}")


def _looked_at(pods: Pods, name: str) -> Json:
    """The pod; empty where the API server is away for a moment."""
    try:
        return pods.get(name)
    except ClusterError as error:
        if error.status == 404:
            raise PullError(f"pod {name} was removed by somebody else: pull again") from error
        if not error.passing:
            raise
        return {}


def _end(pods: Pods, name: str) -> str:
    try:
        return end_of(pods.get(name))
    except ClusterError as error:
        return "somebody has removed it" if error.status == 404 else ""


def _remove(pods: Pods, manifest: Json, say: Say) -> None:
    name = str(manifest["metadata"]["name"])
    for attempt in range(_REMOVALS):
        try:
            pods.remove(name)
        except ClusterError as error:
            if error.passing and attempt + 1 < _REMOVALS:
                continue
            namespace = pods.cluster.namespace
            say(
                f"pod {name} is left in namespace {namespace}: {plain(error.message)}. It ends by"
                f" itself {manifest['spec']['activeDeadlineSeconds']} s after its start; `kubectl"
                f"{in_context()} -n {namespace} delete pod {name}` removes it"
            )
        return


@contextlib.contextmanager
def _signals(
    numbers: Sequence[signal.Signals], handler: Callable[[int, FrameType | None], object] | int
) -> Iterator[None]:
    """Another handler for signals, where this thread may set it.

    What is ignored stays so: nohup lets a pull outlive its terminal.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    heeded = [number for number in numbers if signal.getsignal(number) != signal.SIG_IGN]
    before = {number: signal.signal(number, handler) for number in heeded}
    try:
        yield
    finally:
        for number, former in before.items():
            signal.signal(number, former)


@contextlib.contextmanager
def _later(numbers: Sequence[signal.Signals]) -> Iterator[None]:
    """Signals wait for the end of a request, which has a deadline of its own.

    A pod whose creation was cut off might come to be after it was removed.
    """
    came: list[int] = []
    try:
        with _signals(numbers, lambda number, _frame: came.append(number)):
            yield
    finally:
        if came:
            signal.raise_signal(came[0])


def _end_by(number: int, _frame: FrameType | None) -> NoReturn:
    raise SystemExit(128 + number)
