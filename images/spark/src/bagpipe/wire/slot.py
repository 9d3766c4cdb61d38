"""Slots: which FIFO pairs an executor's agent offers, and the lease that makes one ours."""

import contextlib
import errno
import fcntl
import os
import select
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

PIPE_BYTES = 256 * 1024
_RETRY_SECONDS = 0.02
_HANG_UP_SECONDS = 10.0
_F_SETPIPE_SZ = 1031
_F_GETPIPE_SZ = 1032


class SlotUnavailableError(Exception):
    """No slot, or no agent behind one, within the deadline."""


@dataclass(frozen=True)
class FifoPair:
    """Two named pipes: the worker writes `to_agent` and reads `from_agent`."""

    to_agent: Path
    from_agent: Path


class Slot(FifoPair):
    """One FIFO pair below the volume that Spark and the agent share."""

    def __init__(self, folder: Path) -> None:
        super().__init__(folder / "to-agent", folder / "from-agent")

    @property
    def folder(self) -> Path:
        """Where both lie, with the lease."""
        return self.to_agent.parent


@dataclass
class Ends:
    """The worker's two open ends; both are non-blocking."""

    slot: FifoPair
    read: int
    write: int
    pipe_bytes: int

    def reopen_read(self) -> None:
        """Leave an earlier session's end of the stream behind, without a moment unopened."""
        old, self.read = self.read, _open_for_reading(self.slot.from_agent)
        os.close(old)
        _widen(self.read)


@contextlib.contextmanager
def lease(shared: Path, deadline: float) -> Iterator[Slot]:
    """Any free slot below `shared`, ours until the block ends or the process dies.

    `deadline` is on the monotonic clock, in seconds. Raises SlotUnavailableError.
    """
    while True:
        for folder in sorted((shared / "slots").glob("*"), key=lambda path: path.name):
            descriptor = os.open(folder / "lease", os.O_RDWR | os.O_CLOEXEC)
            try:
                fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except BlockingIOError:
                os.close(descriptor)
                continue
            try:
                yield Slot(folder)
            finally:
                os.close(descriptor)
            return
        _pause_until(
            deadline, f"no free slot below {shared}: all are leased or the agent made none"
        )


@contextlib.contextmanager
def lease_file(pair: FifoPair, deadline: float) -> Iterator[FifoPair]:
    """That pair, ours until the block ends or the process dies, by a lock file beside it.

    `deadline` is on the monotonic clock, in seconds. Raises SlotUnavailableError.
    """
    path = pair.to_agent.with_name(f"{pair.to_agent.name}.lease")
    try:
        descriptor = os.open(path, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o666)
    except OSError as error:
        raise SlotUnavailableError(f"{path} can't be made: {error.strerror}") from error
    try:
        while True:
            try:
                fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
                break
            except BlockingIOError:
                _pause_until(deadline, f"{pair.to_agent} is leased to another task")
        yield pair
    finally:
        os.close(descriptor)


@contextlib.contextmanager
def open_ends(slot: FifoPair, deadline: float) -> Iterator[Ends]:
    """Both FIFOs of a slot, opened in the one order that can't deadlock.

    Raises SlotUnavailableError when no agent opens its end before `deadline`.
    """
    read = _open_for_reading(slot.from_agent)
    try:
        write = _open_for_writing(slot.to_agent, deadline)
    except BaseException:
        os.close(read)
        raise
    ends = Ends(slot, read, write, min(_widen(read), _widen(write)))
    try:
        yield ends
    finally:
        os.close(ends.write)
        _await_hang_up(ends.read)
        os.close(ends.read)


def _open_for_reading(path: Path) -> int:
    return os.open(path, os.O_RDONLY | os.O_NONBLOCK | os.O_CLOEXEC)


def _await_hang_up(read: int) -> None:
    """Read until the agent closes its end, which it does when it is ready for another session.

    Without this the next session's HELLO could follow this one's bytes into the same open
    FIFO and be thrown away as a leftover.
    """
    deadline = time.monotonic() + _HANG_UP_SECONDS
    while (left := deadline - time.monotonic()) > 0:
        try:
            if not os.read(read, PIPE_BYTES):
                return
        except BlockingIOError:
            select.select([read], [], [], left)


def _open_for_writing(path: Path, deadline: float) -> int:
    while True:
        try:
            return os.open(path, os.O_WRONLY | os.O_NONBLOCK | os.O_CLOEXEC)
        except OSError as error:
            if error.errno != errno.ENXIO:
                raise
        _pause_until(deadline, f"no agent reads {path}: its container is gone or still starting")


def _pause_until(deadline: float, message: str) -> None:
    left = deadline - time.monotonic()
    if left <= 0:
        raise SlotUnavailableError(message)
    select.select([], [], [], min(_RETRY_SECONDS, left))


def _widen(descriptor: int) -> int:
    # EPERM says that the node's soft limit for pipes is used up: slower, not wrong.
    with contextlib.suppress(PermissionError):
        fcntl.fcntl(descriptor, _F_SETPIPE_SZ, PIPE_BYTES)
    return fcntl.fcntl(descriptor, _F_GETPIPE_SZ)
