"""One session: a case goes to the agent, its result and its recorded bag come back.

Both directions are pumped by one poll loop, so neither side can wait for the other to
read first. Every wait ends at the deadline; the peer's death is an error, never a hang.
"""

import os
import select
import time
import uuid
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from typing import Any, BinaryIO

import bagpipe
from bagpipe.pipe.frames import Decoder, Encoder, Frame, FrameType, ProtocolError
from bagpipe.pipe.slot import Ends

PROTOCOL = 1
_READ_BYTES = 256 * 1024


class SessionError(Exception):
    """A session without a result; `reason` is CamelCase, `stderr` the stack's last lines."""

    def __init__(self, reason: str, message: str, stderr: list[str] | None = None) -> None:
        super().__init__(message)
        self.reason = reason
        self.stderr = stderr or []


@dataclass(frozen=True)
class InputFile:
    """A stream of bytes for the agent: `size` bytes that `pieces` yields.

    `ranges` are (offset in the stream, offset in the file `name`, length), in bytes.
    """

    name: str
    size: int
    ranges: list[tuple[int, int, int]]
    pieces: Callable[[], Iterator[bytes]]


@dataclass
class Answer:
    """What the agent sent: the RESULT map and how many bytes went into the sink."""

    hello: dict[str, Any] = field(default_factory=dict)
    result: dict[str, Any] = field(default_factory=dict)
    files: int = 0
    bytes: int = 0
    finished: bool = False


def run_session(
    ends: Ends, case: dict[str, Any], files: list[InputFile], sink: BinaryIO, deadline: float
) -> Answer:
    """Feed one case and receive its answer; recorded bytes are written to `sink` as they come.

    `deadline` is on the monotonic clock, in seconds. Raises SessionError.
    """
    session = uuid.uuid4().hex
    outgoing = _outgoing(session, case, files)
    receiver = _Receiver(session, sink)
    poller = select.poll()
    poller.register(ends.read, select.POLLIN)
    poller.register(ends.write, select.POLLOUT)
    pending: list[memoryview] = []
    writing = True
    while not receiver.answer.finished:
        events = dict(poller.poll(_left_milliseconds(deadline)))
        if ends.read in events:
            _receive(ends.read, receiver)
        elif writing and ends.write in events:
            writing = _send(ends.write, outgoing, pending)
            if not writing:
                poller.unregister(ends.write)
    return receiver.answer


def _left_milliseconds(deadline: float) -> int:
    left = deadline - time.monotonic()
    if left <= 0:
        raise SessionError(
            "CaseDeadlineExceeded", "the agent sent no result before the case's deadline"
        )
    return int(left * 1000) + 1


def _send(
    descriptor: int, outgoing: Iterator[bytes | memoryview], pending: list[memoryview]
) -> bool:
    """Write once; False when everything has been sent or nobody reads any more."""
    if not pending:
        piece = next(outgoing, None)
        if piece is None:
            return False
        pending.append(memoryview(piece))
    try:
        written = os.write(descriptor, pending[0])
    except BlockingIOError:
        return True
    except BrokenPipeError:
        # Why the agent left is told by its ABORT or the end of its stream, which are read next.
        return False
    rest = pending.pop()[written:]
    if len(rest):
        pending.append(rest)
    return True


def _outgoing(
    session: str, case: dict[str, Any], files: list[InputFile]
) -> Iterator[bytes | memoryview]:
    encoder = Encoder()
    software = f"bagpipe {bagpipe.__version__}"
    hello = {"session": session, "protocol": PROTOCOL, "software": software, "case": case}
    yield encoder.encode_fields(FrameType.HELLO, hello)
    total = 0
    for file in files:
        described = {"name": file.name, "size": file.size, "ranges": file.ranges}
        yield encoder.encode_fields(FrameType.FILE, described)
        for piece in file.pieces():
            total += len(piece)
            yield from encoder.encode(FrameType.DATA, piece)
    end = {"files": len(files), "bytes": total, "digest": encoder.digest}
    yield encoder.encode_fields(FrameType.END, end)


def _receive(descriptor: int, receiver: "_Receiver") -> None:
    try:
        data = os.read(descriptor, _READ_BYTES)
    except BlockingIOError:
        return
    if not data:
        receiver.closed()
        return
    try:
        receiver.feed(data)
    except ProtocolError as error:
        raise SessionError("ProtocolError", str(error)) from error


class _Receiver:
    """The agent's half of the protocol."""

    def __init__(self, session: str, sink: BinaryIO) -> None:
        self.answer = Answer()
        self._session = session
        self._sink = sink
        self._decoder = Decoder()
        self._expected = 0

    def feed(self, data: bytes) -> None:
        for frame in self._decoder.feed(data):
            if self.answer.finished:
                raise ProtocolError(0, f"{frame.type.name} after END")
            self._take(frame)

    def closed(self) -> None:
        raise SessionError(
            "AgentDied",
            "the agent closed the pipe without a result: its container ended or was killed"
            f" (got {self.answer.bytes} recorded bytes, {self._decoder.pending} of a cut frame)",
        )

    def _take(self, frame: Frame) -> None:
        match frame.type:
            case FrameType.ABORT:
                raise _aborted(frame.fields())
            case FrameType.HELLO:
                self._greet(frame.fields())
            case _ if not self.answer.hello:
                raise ProtocolError(0, f"{frame.type.name} before HELLO")
            case FrameType.METRIC:
                pass
            case FrameType.RESULT:
                self.answer.result = frame.fields()
            case FrameType.FILE:
                self._expected += int(frame.fields()["size"])
                self.answer.files += 1
            case FrameType.DATA:
                self._sink.write(frame.payload)
                self.answer.bytes += len(frame.payload)
            case FrameType.END:
                self._finish(frame.fields())

    def _greet(self, fields: dict[str, Any]) -> None:
        if fields.get("session") != self._session:
            raise SessionError(
                "StaleSession", f"the pipe still holds the session {fields.get('session')}"
            )
        if fields.get("protocol") != PROTOCOL:
            raise SessionError(
                "ProtocolError",
                f"the agent speaks protocol {fields.get('protocol')}, this worker {PROTOCOL}:"
                " use one release's images together",
            )
        self.answer.hello = fields

    def _finish(self, fields: dict[str, Any]) -> None:
        expected = {
            "files": self.answer.files,
            "bytes": self.answer.bytes,
            "digest": self._decoder.digest_before_last,
        }
        got = {key: fields.get(key) for key in expected}
        if got != expected or self._expected != self.answer.bytes or not self.answer.result:
            raise ProtocolError(0, f"END says {got}, received {expected}")
        self.answer.finished = True


def _aborted(fields: dict[str, Any]) -> SessionError:
    message = str(fields.get("message", "the agent gave no message"))
    stderr = [str(line) for line in fields.get("stderr") or []]
    return SessionError(str(fields.get("reason", "Internal")), message, stderr)
