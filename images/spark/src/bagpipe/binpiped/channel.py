"""The two ways to a program: one that we start, and one that serves named pipes."""

import contextlib
import ctypes
import fcntl
import os
import select
import signal
import subprocess
import time
from collections import deque
from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path
from typing import IO, Protocol

from bagpipe.binpiped.failure import BinPipedError
from bagpipe.binpiped.logic import Command, Fifos, Logic, Slots
from bagpipe.wire.slot import Ends, FifoPair, SlotUnavailableError, lease, lease_file, open_ends

PIPE_BYTES = 1 << 20
# What is kept of stderr for the error: whole lines, the last ones.
STDERR_LINES, STDERR_LINE_BYTES = 20, 500
_F_SETPIPE_SZ = 1031
_PR_SET_PDEATHSIG = 1
# How long a program that has closed its stdout may take to be gone before we take it for stuck.
_EXIT_SECONDS = 10.0
_OPEN_SECONDS = 30.0
# Faults of a program that may well run on: its exit status would only be ours.
_KILLED_FOR = {"DeadlineExceeded", "RecordDeadlineExceeded", "ProtocolError", "ProgramStuck"}
_LIBC = ctypes.CDLL(None, use_errno=True)


class Channel(Protocol):
    """A program's ends, all non-blocking; `stderr` is -1 where there is none to read."""

    read: int
    write: int
    stderr: int
    # A fresh pipe holds nothing of an earlier session.
    fresh: bool

    def finish_writing(self) -> None:
        """All input is in the pipe."""

    def reopen_read(self) -> bool:
        """Whether an end of the stream was an earlier session's and reading can go on."""

    def read_stderr(self) -> None:
        """Read what there is on stderr."""

    def await_exit(self, deadline: float) -> None:
        """After the last frame. Raises BinPipedError for an end that isn't good."""

    def failed(self, reason: str, message: str) -> BinPipedError:
        """That failure with all that is known of how the program ended."""


@contextlib.contextmanager
def open_channel(logic: Logic, seconds: float) -> Iterator[Channel]:
    """Start or find the program; whatever happens, nothing of it is left when the block ends.

    `seconds` bound the wait for a lease that other tasks have. Raises BinPipedError.
    """
    if isinstance(logic, Command):
        channel = StartedProgram(logic)
        try:
            yield channel
        finally:
            channel.close()
        return
    with ExitStack() as stack:
        try:
            pair = _pair(logic, stack, time.monotonic() + seconds)
            opened_by = time.monotonic() + min(seconds, _OPEN_SECONDS)
            ends = stack.enter_context(open_ends(pair, opened_by))
        except (SlotUnavailableError, OSError) as error:
            raise BinPipedError("NobodyServes", str(error)) from error
        yield ServedFifos(ends)


def _pair(logic: Fifos | Slots, stack: ExitStack, deadline: float) -> FifoPair:
    if isinstance(logic, Slots):
        return stack.enter_context(lease(Path(logic.folder), deadline))
    return stack.enter_context(
        lease_file(FifoPair(Path(logic.to_program), Path(logic.from_program)), deadline)
    )


class StartedProgram:
    """A process group of our own, with pipes on all three standard descriptors."""

    fresh = True

    def __init__(self, command: Command) -> None:
        self._name = command.arguments[0]
        environment = {**os.environ, "BAGPIPE_BINPIPE": "1", **dict(command.environment)}
        try:
            self._process = subprocess.Popen(
                command.arguments,
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=subprocess.PIPE,
                bufsize=0,
                env=environment,
                cwd=command.folder,
                start_new_session=True,
                # A Python worker has one thread; Spark kills it with SIGKILL, and then the
                # program must not be left behind.
                preexec_fn=_die_with_parent,  # noqa: PLW1509
            )
        except (OSError, subprocess.SubprocessError) as error:
            raise BinPipedError(
                "CannotStart", f"{self._name} can't be started: {error}; is it in the image?"
            ) from error
        self.write = _descriptor(self._process.stdin)
        self.read = _descriptor(self._process.stdout)
        self.stderr = _descriptor(self._process.stderr)
        self._words = _LastLines()
        for descriptor in (self.write, self.read, self.stderr):
            os.set_blocking(descriptor, False)
        for descriptor in (self.write, self.read):
            # EPERM says that the node's soft limit for pipes is used up: slower, not wrong.
            with contextlib.suppress(PermissionError):
                fcntl.fcntl(descriptor, _F_SETPIPE_SZ, PIPE_BYTES)

    def finish_writing(self) -> None:
        """End the program's stdin."""
        if self._process.stdin:
            self._process.stdin.close()

    def reopen_read(self) -> bool:
        """Its stdout ends once."""
        return False

    def read_stderr(self) -> None:
        """Keep the last lines of stderr."""
        try:
            data = os.read(self.stderr, 65536)
        except BlockingIOError:
            return
        self._words.feed(data)
        if not data:
            self.stderr = -1

    def await_exit(self, deadline: float) -> None:
        """Wait for the process; only the exit status 0 is a good end."""
        self._await(min(deadline, time.monotonic() + _EXIT_SECONDS))
        if self._process.returncode is None:
            seconds = f"{_EXIT_SECONDS:.0f} s"
            raise self.failed("ProgramStuck", f"no exit within {seconds} of the last record")
        if self._process.returncode:
            raise self.failed("ProgramFailed", "all records came, but that is no good end")

    def failed(self, reason: str, message: str) -> BinPipedError:
        """Say how the process ended; one that runs on is killed for its fault."""
        self.finish_writing()
        if reason not in _KILLED_FOR:
            self._await(time.monotonic() + _EXIT_SECONDS / 5)
        status = self._process.poll()
        self._kill()
        self._drain_stderr()
        ending = "was killed" if status is None else _ending(status)
        return BinPipedError(
            reason,
            f"{message}; {self._name} {ending}",
            exit_status=status if status is not None and status >= 0 else None,
            signal=-status if status is not None and status < 0 else None,
            stderr=self._words.lines(),
        )

    def close(self) -> None:
        """Kill what is left of the process group, and let go of the descriptors."""
        self._kill()
        for file in (self._process.stdin, self._process.stdout, self._process.stderr):
            if file:
                file.close()

    def _await(self, deadline: float) -> None:
        """Until the process has ended or the deadline passed, reading stderr all the while."""
        pidfd = os.pidfd_open(self._process.pid) if self._process.poll() is None else -1
        if pidfd < 0:
            return
        try:
            while (left := deadline - time.monotonic()) > 0:
                poller = select.poll()
                poller.register(pidfd, select.POLLIN)
                if self.stderr >= 0:
                    poller.register(self.stderr, select.POLLIN)
                ready = dict(poller.poll(int(left * 1000) + 1))
                if self.stderr in ready:
                    self.read_stderr()
                if pidfd in ready:
                    break
        finally:
            os.close(pidfd)
        self._process.poll()

    def _kill(self) -> None:
        # The group may outlive its leader: children that it left behind.
        with contextlib.suppress(ProcessLookupError, PermissionError):
            os.killpg(self._process.pid, signal.SIGKILL)
        self._process.wait(_EXIT_SECONDS)

    def _drain_stderr(self) -> None:
        for _ in range(64):
            if self.stderr < 0 or not select.select([self.stderr], [], [], 0)[0]:
                return
            self.read_stderr()


class ServedFifos:
    """A program that something else keeps running."""

    stderr = -1
    fresh = False

    def __init__(self, ends: Ends) -> None:
        self._ends = ends
        self.read = ends.read
        self.write = ends.write

    def finish_writing(self) -> None:
        """The pipe stays open until the session has ended, so that no other's bytes mix in."""

    def reopen_read(self) -> bool:
        """The end of an earlier session is not ours."""
        self._ends.reopen_read()
        self.read = self._ends.read
        return True

    def read_stderr(self) -> None:
        """Its stderr belongs to whoever started it."""

    def await_exit(self, deadline: float) -> None:
        """It goes on running."""

    def failed(self, reason: str, message: str) -> BinPipedError:
        """Only the pipes are known here."""
        return BinPipedError(reason, f"{message}; its pipe is {self._ends.slot.to_agent}")


class _LastLines:
    """The last lines of a stream, cut to a bound, whatever is written."""

    def __init__(self) -> None:
        self._lines: deque[bytes] = deque(maxlen=STDERR_LINES)
        self._rest = b""

    def feed(self, data: bytes) -> None:
        *whole, rest = (self._rest + data).split(b"\n")
        self._lines.extend(line[:STDERR_LINE_BYTES] for line in whole)
        self._rest = rest[-STDERR_LINE_BYTES:]

    def lines(self) -> list[str]:
        rest = [self._rest] if self._rest else []
        return [line.decode(errors="replace") for line in [*self._lines, *rest] if line.strip()]


def _descriptor(file: IO[bytes] | None) -> int:
    return file.fileno() if file else -1


def _die_with_parent() -> None:
    _LIBC.prctl(_PR_SET_PDEATHSIG, signal.SIGKILL)


def _ending(status: int) -> str:
    if status < 0:
        return f"was ended by signal {-status} ({signal.Signals(-status).name})"
    return f"ended with exit status {status}"
