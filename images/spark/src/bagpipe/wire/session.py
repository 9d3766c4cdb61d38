"""One session: a case goes to the agent, its result and its recorded bag come back.

Both directions are pumped by one poll loop, so neither side can wait for the other to
read first. Every wait ends at the deadline; the peer's death is an error, never a hang.
"""

import os
import select
import time
import uuid
from collections import deque
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any, Protocol, cast

from pydantic import TypeAdapter

import bagpipe
from bagpipe.wire.frames import (
    BrokenStreamError,
    Decoder,
    Encoder,
    Frame,
    FrameType,
    ProtocolError,
    payloads,
)
from bagpipe.wire.greeting import Greeting
from bagpipe.wire.maps import session as maps
from bagpipe.wire.maps.result import RESULT
from bagpipe.wire.maps.shape import MapError, check
from bagpipe.wire.maps.turns import ANSWER
from bagpipe.wire.slot import Ends

PROTOCOL = 1
# Longer than an agent needs to end the case of a worker that died before us.
GREETING_SECONDS = 30.0
_READ_BYTES = 256 * 1024
# Messages of one simulated moment above this go out as DATA: a frame has at most 1 MiB.
_MOST_STEP_BYTES = 512 * 1024


class SessionError(Exception):
    """A session without a result; `reason` is CamelCase, `stderr` the stack's last lines."""

    def __init__(self, reason: str, message: str, stderr: list[str] | None = None) -> None:
        super().__init__(message)
        self.reason = reason
        self.stderr = stderr or []


class AgentGoneError(SessionError):
    """The agent had taken the case, and left the pipe: its container ended with the stack in it.

    So it is where its stream goes on with another's bytes: a worker that looks late has its frames
    read by the agent that comes after the one that was ended.
    """


@dataclass(frozen=True)
class InputFile:
    """A stream of bytes for the agent: `size` bytes that `pieces` yields.

    `ranges` are (offset in the stream, offset in the file `name`, length), in bytes.
    """

    name: str
    size: int
    ranges: list[tuple[int, int, int]]
    pieces: Callable[[], Iterator[bytes | memoryview]]


class Sink(Protocol):
    """Where recorded bytes go as they come."""

    def write(self, data: bytes, /) -> object:
        """Append."""


@dataclass
class Answer:
    """What the agent sent: the RESULT map and how many bytes went into the sink.

    `input_bytes` is how many were for the agent: the bytes of its files.
    """

    hello: dict[str, Any] = field(default_factory=dict)
    result: dict[str, Any] = field(default_factory=dict)
    files: int = 0
    bytes: int = 0
    input_bytes: int = 0
    finished: bool = False


def engine_result(answer: Answer, model: TypeAdapter[Any]) -> dict[str, Any]:
    """RESULT, compared with the model of the case's engine. Raises SessionError."""
    try:
        check("RESULT", model, answer.result)
    except MapError as error:
        raise SessionError("ProtocolError", str(error)) from error
    return answer.result


class Partner(Protocol):
    """A simulator that has its turn whenever the agent has answered."""

    def step(self, answer: dict[str, Any], /) -> dict[str, Any] | None:
        """STEP's map after ANSWER's; None when the drive is over. Raises SessionError."""


class Sinks(Protocol):
    """Where each of several files goes."""

    def begin(self, name: str, size: int | None) -> Sink:
        """The sink of the next file, of `size` bytes, or of as many as come."""


def run_session(
    ends: Ends,
    case: Mapping[str, object],
    files: list[InputFile],
    sink: Sink | Sinks,
    deadline: float,
) -> Answer:
    """Feed one case and receive its answer; recorded bytes are written to `sink` as they come.

    Sinks are asked for one with every file; a single sink takes the bytes of all.
    `deadline` is on the monotonic clock, in seconds. Raises SessionError.
    """
    session = uuid.uuid4().hex
    receiver = _Receiver(session, sink)
    receiver.answer.input_bytes = sum(file.size for file in files)
    return _exchange(ends, receiver, _Sender(_outgoing(session, case, files)), deadline)


def run_turns(
    ends: Ends, case: Mapping[str, object], partner: Partner, sink: Sink | Sinks, deadline: float
) -> Answer:
    """Let a simulator and the stack take turns; otherwise as `run_session`."""
    session = uuid.uuid4().hex
    answers: deque[dict[str, Any]] = deque()
    sender = _Sender(_turns(session, case, partner, answers))

    def answered(answer: dict[str, Any]) -> None:
        answers.append(answer)
        sender.resume()

    receiver = _Receiver(session, sink, answered)
    return _exchange(ends, receiver, sender, deadline)


def _exchange(ends: Ends, receiver: "_Receiver", sender: "_Sender", deadline: float) -> Answer:
    greeting_deadline = min(deadline, time.monotonic() + GREETING_SECONDS)
    while not receiver.answer.finished:
        left = (deadline if receiver.answer.hello else greeting_deadline) - time.monotonic()
        if left <= 0:
            raise _too_late(receiver)
        readable, writable = _await_either(ends, sender, left)
        if readable:
            _receive(ends, receiver, sender.peer_gone)
        elif writable:
            sender.send(ends.write)
        elif sender.peer_gone:
            raise _agent_died(receiver)
    return receiver.answer


def _await_either(ends: Ends, sender: "_Sender", seconds: float) -> tuple[bool, bool]:
    """Whether there is something to read, and whether the sender can go on or must look."""
    poller = select.poll()
    poller.register(ends.read, select.POLLIN)
    if not sender.peer_gone:
        # Without POLLOUT the hang-up of the other side is still reported.
        poller.register(ends.write, select.POLLOUT if sender.active else 0)
    events = dict(poller.poll(0 if sender.peer_gone else int(seconds * 1000) + 1))
    return ends.read in events, ends.write in events


def _too_late(receiver: "_Receiver") -> SessionError:
    if not receiver.answer.hello:
        return SessionError(
            "AgentDied", f"the agent did not answer within {GREETING_SECONDS:.0f} s of HELLO"
        )
    return SessionError(
        "CaseDeadlineExceeded", "the agent sent no result before the case's deadline"
    )


def _agent_died(receiver: "_Receiver") -> SessionError:
    # One that has not greeted has started no stack.
    kind = AgentGoneError if receiver.answer.hello else SessionError
    return kind(
        "AgentDied",
        "the agent left the pipe without a result: its container ended or was killed"
        f" (got {receiver.answer.bytes} recorded bytes, {receiver.pending} of a cut frame)",
    )


class _Sender:
    """Writes the worker's frames as the pipe takes them."""

    def __init__(self, outgoing: Iterator[bytes | memoryview | None]) -> None:
        self._outgoing = outgoing
        self._rest = memoryview(b"")
        self.active = True
        self.peer_gone = False

    def resume(self) -> None:
        """There is more to send, unless nobody reads any more."""
        self.active = not self.peer_gone

    def send(self, descriptor: int) -> None:
        """Write once, or note that nobody reads any more."""
        if not self.active:
            self.peer_gone = True
            return
        if not self._rest:
            piece = next(self._outgoing, None)
            if piece is None:
                self.active = False
                return
            self._rest = memoryview(piece)
        try:
            self._rest = self._rest[os.write(descriptor, self._rest) :]
        except BlockingIOError:
            return
        except BrokenPipeError:
            # The agent's ABORT or the end of its stream, read next, gives the reason.
            self.active = False
            self.peer_gone = True


def _outgoing(
    session: str, case: Mapping[str, object], files: list[InputFile]
) -> Iterator[bytes | memoryview]:
    encoder = Encoder()
    yield _hello(encoder, session, case)
    total = 0
    for file in files:
        described = {"name": file.name, "size": file.size, "ranges": file.ranges}
        yield encoder.encode_fields(FrameType.FILE, described)
        for piece in file.pieces():
            total += len(piece)
            yield from encoder.encode(FrameType.DATA, piece)
    end = {"files": len(files), "bytes": total, "digest": encoder.digest}
    yield encoder.encode_fields(FrameType.END, end)


def _turns(
    session: str, case: Mapping[str, object], partner: Partner, answers: deque[dict[str, Any]]
) -> Iterator[bytes | memoryview | None]:
    """The frames of a simulator; None while the agent has its turn."""
    encoder = Encoder()
    yield _hello(encoder, session, case)
    total = 0
    while True:
        while not answers:
            yield None
        step = partner.step(answers.popleft())
        if step is None:
            break
        if sum(len(data) for _, data in step["messages"]) > _MOST_STEP_BYTES:
            for _, data in step["messages"]:
                total += len(data)
                for payload in payloads(data):
                    yield from encoder.encode(FrameType.DATA, payload)
            lengths = [[place, len(data)] for place, data in step["messages"]]
            step = step | {"messages": lengths}
        yield encoder.encode_fields(FrameType.STEP, step)
    end = {"files": 0, "bytes": total, "digest": encoder.digest}
    yield encoder.encode_fields(FrameType.END, end)


def _hello(encoder: Encoder, session: str, case: Mapping[str, object]) -> bytes:
    software = f"bagpipe {bagpipe.__version__}"
    hello = {"session": session, "protocol": PROTOCOL, "software": software, "case": case}
    return encoder.encode_fields(FrameType.HELLO, hello)


def _receive(ends: Ends, receiver: "_Receiver", peer_gone: bool) -> None:
    try:
        data = os.read(ends.read, _READ_BYTES)
    except BlockingIOError:
        return
    if data:
        try:
            receiver.feed(data)
        except BrokenStreamError as error:
            raise AgentGoneError("ProtocolError", str(error)) from error
        except (ProtocolError, MapError) as error:
            raise SessionError("ProtocolError", str(error)) from error
    elif receiver.answer.hello or peer_gone:
        raise _agent_died(receiver)
    else:
        # An earlier session has ended; ours has not been answered yet.
        ends.reopen_read()


class _Receiver:
    """The agent's half of the protocol."""

    def __init__(
        self,
        session: str,
        sink: Sink | Sinks,
        answered: Callable[[dict[str, Any]], None] | None = None,
    ) -> None:
        self.answer = Answer()
        self._answered = answered
        self._greeting = Greeting(session)
        self._greeted = False
        self._begin = getattr(sink, "begin", None)
        self._sink = cast("Sink", sink)
        self._decoder = Decoder()
        self._expected = 0
        self._unsized = False

    @property
    def pending(self) -> int:
        """Bytes of a frame that is not whole."""
        return self._decoder.pending

    def feed(self, data: bytes) -> None:
        stream: bytes | None = data
        if not self._greeted:
            stream = self._greeting.feed(data)
            self._greeted = stream is not None
        for frame in self._decoder.feed(stream or b""):
            if self.answer.finished:
                raise ProtocolError(0, f"{frame.type.name} after END")
            self._take(frame)

    def _take(self, frame: Frame) -> None:
        match frame.type:
            case FrameType.ABORT:
                raise _aborted(frame.fields())
            case FrameType.HELLO:
                self._greet(frame.fields())
            case FrameType.METRIC:
                pass
            case FrameType.RESULT:
                self._keep_result(frame.fields())
            case FrameType.FILE:
                self._begin_file(frame.fields())
            case FrameType.DATA:
                self._sink.write(frame.payload)
                self.answer.bytes += len(frame.payload)
                self._expected += len(frame.payload) if self._unsized else 0
            case FrameType.END:
                self._finish(frame.fields())
            case FrameType.ANSWER if self._answered is not None:
                fields = frame.fields()
                check("ANSWER", ANSWER, fields)
                self._answered(fields)
            case FrameType.ANSWER | FrameType.STEP:
                raise ProtocolError(0, f"{frame.type.name} came, and no simulator has its turn")

    def _keep_result(self, fields: dict[str, Any]) -> None:
        check("RESULT", RESULT, fields)
        self.answer.result = fields

    def _begin_file(self, fields: dict[str, Any]) -> None:
        check("FILE", maps.FILE, fields)
        # A program of the exec engine need not know a file's size when it begins.
        size = fields.get("size")
        self._unsized = size is None
        self._expected += 0 if size is None else size
        self.answer.files += 1
        if self._begin is not None:
            self._sink = self._begin(fields["name"], size)

    def _greet(self, fields: dict[str, Any]) -> None:
        if fields.get("protocol") != PROTOCOL:
            raise SessionError(
                "ProtocolError",
                f"the agent speaks protocol {fields.get('protocol')}, this worker {PROTOCOL}:"
                " use one release's images together",
            )
        check("HELLO", maps.HELLO, fields)
        self.answer.hello = fields

    def _finish(self, fields: dict[str, Any]) -> None:
        check("END", maps.END, fields)
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
    check("ABORT", maps.ABORT, fields)
    message, stderr = fields["message"], fields.get("stderr", [])
    for kind, value in (
        ("exit status", fields.get("exit_status")),
        ("signal", fields.get("signal")),
    ):
        if value is not None:
            message += f" ({kind} {value})"
    if stderr:
        message += f"; its last line on stderr: {stderr[-1]}"
    return SessionError(fields["reason"], message, stderr)
