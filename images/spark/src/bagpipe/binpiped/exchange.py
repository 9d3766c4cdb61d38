"""One partition through the program: both directions at once, in bounded memory and time.

The worker holds one batch of frames, one frame that arrives, and nothing of a record else. It
is a generator: what Spark does not take yet stays in the pipe, and the program waits.
"""

import math
import os
import select
import time
import uuid
from collections.abc import Generator, Iterable, Iterator

from bagpipe.binpiped.channel import Channel, open_channel
from bagpipe.binpiped.logic import Deadlines, Logic
from bagpipe.binpiped.receiver import GaveUpError, Receiver
from bagpipe.binpiped.record import InputRecord, OutputHead
from bagpipe.binpiped.sender import Sender
from bagpipe.wire.frames import ProtocolError

# A child that inherited the program's stdout may hold it open; nobody waits for that.
SILENCE_SECONDS = 10.0


def exchange(
    logic: Logic, records: Iterable[InputRecord], deadlines: Deadlines
) -> Generator[OutputHead | bytes, None, None]:
    """The output records of a partition: each one's head, then its bytes in pieces of up to 1 MiB.

    Raises BinPipedError, and what reading the records raises. The program is gone afterwards.
    """
    with open_channel(logic, deadlines.partition) as channel:
        session = uuid.uuid4().hex
        sender = Sender(session, records)
        receiver = Receiver(session, fresh=channel.fresh)
        pump = _Pump(channel, sender, receiver, deadlines)
        try:
            yield from pump.run()
        except ProtocolError as error:
            raise channel.failed("ProtocolError", _explained(error, receiver)) from error
        except GaveUpError as error:
            raise channel.failed(error.reason, f"{error} ({pump.progress()})") from error


class _Clock:
    """The program's time: it stands still while others work on what it gave."""

    def __init__(self, deadlines: Deadlines) -> None:
        self._deadlines = deadlines
        now = time.monotonic()
        self.deadline = now + deadlines.partition
        self._idle_deadline = now + deadlines.record

    def moved(self) -> None:
        self._idle_deadline = time.monotonic() + self._deadlines.record

    def stood(self, seconds: float) -> None:
        self.deadline += seconds
        self._idle_deadline += seconds

    def left(self) -> float:
        return min(self.deadline, self._idle_deadline) - time.monotonic()

    def fault(self) -> tuple[str, str]:
        if self.deadline <= self._idle_deadline:
            limit = f"{self._deadlines.partition:g} s for the partition (timeout=) are over"
            return "DeadlineExceeded", limit
        limit = f"it took and gave nothing for {self._deadlines.record:g} s (record_timeout=)"
        return "RecordDeadlineExceeded", limit


class _Pump:
    """The poll loop."""

    def __init__(
        self, channel: Channel, sender: Sender, receiver: Receiver, deadlines: Deadlines
    ) -> None:
        self._channel = channel
        self._sender = sender
        self._receiver = receiver
        self._clock = _Clock(deadlines)
        self._poller = select.poll()
        self._registered: dict[int, int] = {}

    def progress(self) -> str:
        """How far the partition was, for an error."""
        sender = self._sender
        at = f", the last one {sender.current}" if sender.current else ""
        return f"{sender.records} records sent{at}; {self._receiver.records} received"

    def run(self) -> Iterator[OutputHead | bytes]:
        """Until the program's END has been checked and the program has ended well."""
        channel, receiver = self._channel, self._receiver
        while receiver.end is None:
            ready = self._wait()
            if channel.stderr >= 0 and channel.stderr in ready:
                channel.read_stderr()
            if self._sender.active and channel.write in ready:
                self._send()
            if channel.read in ready or self._sender.peer_gone:
                yield from self._receive()
        self._check_end()
        channel.finish_writing()
        self._await_silence()
        channel.await_exit(self._clock.deadline)

    def _send(self) -> None:
        if self._sender.send(self._channel.write):
            self._clock.moved()
        if not self._sender.active:
            self._forget(self._channel.write)
            self._channel.finish_writing()

    def _wait(self, until: float = math.inf) -> dict[int, int]:
        left = self._clock.left()
        if left <= 0:
            reason, limit = self._clock.fault()
            raise self._channel.failed(reason, f"{limit}: {self.progress()}")
        wanted = {self._channel.read: select.POLLIN}
        if self._sender.active:
            wanted[self._channel.write] = select.POLLOUT
        if self._channel.stderr >= 0:
            wanted[self._channel.stderr] = select.POLLIN
        if wanted != self._registered:
            for descriptor in self._registered.keys() - wanted.keys():
                self._poller.unregister(descriptor)
            for descriptor in wanted.keys() - self._registered.keys():
                self._poller.register(descriptor, wanted[descriptor])
            self._registered = wanted
        left = max(0.0, min(left, until - time.monotonic()))
        return dict(self._poller.poll(min(int(left * 1000) + 1, 1 << 30)))

    def _forget(self, descriptor: int) -> None:
        if self._registered.pop(descriptor, None) is not None:
            self._poller.unregister(descriptor)

    def _receive(self) -> Iterator[OutputHead | bytes]:
        try:
            items = self._read()
        except BlockingIOError:
            return
        if items is None:
            self._ended()
            return
        self._clock.moved()
        for item in items:
            before = time.monotonic()
            yield item
            self._clock.stood(time.monotonic() - before)

    def _read(self) -> Iterator[OutputHead | bytes] | None:
        """What one read brings, None at the end of the stream."""
        receiver, descriptor = self._receiver, self._channel.read
        if missing := receiver.missing:
            piece = os.read(descriptor, missing)
            return receiver.rest(piece) if piece else None
        space = receiver.space()
        count = os.readv(descriptor, [space])
        return receiver.received(space, count) if count else None

    def _ended(self) -> None:
        old = self._channel.read
        if not self._receiver.greeted and not self._sender.peer_gone:
            self._forget(old)
            if self._channel.reopen_read():
                return
        cut = f" ({self._receiver.pending} bytes of a cut frame)" if self._receiver.pending else ""
        raise self._channel.failed(
            "ProgramEnded", f"the program left without END{cut}: {self.progress()}"
        )

    def _check_end(self) -> None:
        receiver, sender = self._receiver, self._sender
        end = receiver.end or {}
        expected = {
            "files": receiver.records, "bytes": receiver.bytes, "digest": receiver.digest,
        }  # fmt: skip
        got = {key: end.get(key) for key in expected}
        if got != expected:
            raise ProtocolError(0, f"END says {got}, received {expected}")
        if sender.digest is None or end.get("input") != sender.digest:
            raise self._channel.failed(
                "InputLeft", f"END does not prove that all input was read: {self.progress()}"
            )

    def _await_silence(self) -> None:
        """After END a program that we started says nothing more and closes its stdout."""
        if not self._channel.fresh:
            return
        limit = time.monotonic() + SILENCE_SECONDS
        while time.monotonic() < limit:
            ready = self._wait(limit)
            if self._channel.stderr in ready:
                self._channel.read_stderr()
            if self._channel.read not in ready:
                continue
            if os.read(self._channel.read, 1):
                raise ProtocolError(0, "bytes after END")
            self._forget(self._channel.read)
            return
        raise self._channel.failed(
            "ProgramStuck", f"its stdout stays open {SILENCE_SECONDS:g} s after END"
        )


def _explained(error: ProtocolError, receiver: Receiver) -> str:
    if receiver.greeted:
        return str(error)
    return (
        f"{error}. The program's stdout is for frames only: use an SDK (docs/reference/"
        "binpipe-api.md) and print to stderr"
    )
