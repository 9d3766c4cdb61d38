"""The program's half of a session, checked: what it may send, when, and how much of it."""

from collections.abc import Iterator
from typing import Any

from bagpipe.binpiped.record import OutputHead, fields_fault
from bagpipe.binpiped.sender import PROTOCOL
from bagpipe.wire.frames import Decoder, Frame, FrameType, ProtocolError
from bagpipe.wire.greeting import Greeting


class GaveUpError(Exception):
    """The program's own ABORT."""

    def __init__(self, reason: str, message: str) -> None:
        super().__init__(message)
        self.reason = reason


class Receiver:
    """Turns bytes into heads and data of output records; raises ProtocolError or GaveUpError.

    It yields each record's OutputHead and then its bytes, piece by piece.
    """

    def __init__(self, session: str, *, fresh: bool) -> None:
        self._session = session
        self._greeting = None if fresh else Greeting(session)
        self._decoder = Decoder()
        self._head: OutputHead | None = None
        self._got = 0
        self.greeted = False
        self.end: dict[str, Any] | None = None
        self.records = 0
        self.bytes = 0

    @property
    def pending(self) -> int:
        """Bytes of a frame that is not whole."""
        return self._decoder.pending

    @property
    def digest(self) -> int:
        """What the END that came must say about the frames before it."""
        return self._decoder.digest_before_last

    @property
    def missing(self) -> int:
        """Bytes to come of a large frame, which may be given to `rest` instead of `space`."""
        return 0 if self._greeting is not None or self._head is None else self._decoder.missing

    def rest(self, piece: bytes) -> Iterator[bytes]:
        """What a piece of a large frame brings: nothing until the frame is whole and checked."""
        for part in self._decoder.rest(piece):
            yield self._data(self._head, part)

    def space(self) -> memoryview:
        """Where the next bytes are to be read to."""
        return self._decoder.space()

    def received(self, space: memoryview, count: int) -> Iterator[OutputHead | bytes]:
        """What `count` bytes that were read into `space` bring."""
        if self._greeting is None:
            frames = self._decoder.received(count)
        else:
            stream = self._greeting.feed(bytes(space[:count]))
            if stream is None:
                return
            self._greeting = None
            frames = self._decoder.feed(stream)
        for frame in frames:
            if frame.type is FrameType.DATA and self._head is not None:
                yield self._data(self._head, frame.payload)
            else:
                yield from self._other(frame)

    def _data(self, head: OutputHead | None, payload: bytes) -> bytes:
        self._got += len(payload)
        self.bytes += len(payload)
        if head is not None and head.size is not None and self._got > head.size:
            raise ProtocolError(0, f"record {head.name} is above the {head.size} bytes of its FILE")
        return payload

    def _other(self, frame: Frame) -> Iterator[OutputHead]:
        if self.end is not None:
            raise ProtocolError(0, f"{frame.type.name} after END")
        if frame.type is FrameType.ABORT:
            fields = frame.fields()
            raise GaveUpError(str(fields.get("reason")), str(fields.get("message")))
        if frame.type is FrameType.HELLO and not self.greeted:
            self._greet(frame.fields())
            return
        if not self.greeted:
            raise ProtocolError(0, f"{frame.type.name} before HELLO")
        self._end_record()
        if frame.type is FrameType.FILE:
            yield self._begin_record(frame.fields())
        elif frame.type is FrameType.END:
            self.end = frame.fields()
        elif frame.type is not FrameType.METRIC:
            raise ProtocolError(0, f"{frame.type.name} where FILE, DATA or END may stand")

    def _greet(self, fields: dict[str, Any]) -> None:
        if fields.get("protocol") != PROTOCOL or fields.get("session") != self._session:
            raise ProtocolError(
                0,
                f"HELLO has protocol {fields.get('protocol')} and session"
                f" {fields.get('session')}, expected {PROTOCOL} and {self._session}",
            )
        self.greeted = True

    def _begin_record(self, fields: dict[str, Any]) -> OutputHead:
        name, size = fields.get("name"), fields.get("size")
        if not isinstance(name, str):
            raise ProtocolError(0, f"FILE has the name {name!r}, expected a string")
        if size is not None and (not isinstance(size, int) or size < 0):
            raise ProtocolError(0, f"record {name} has the size {size!r}, expected bytes or nil")
        typed = fields.get("fields") or {}
        if fault := fields_fault(typed):
            raise ProtocolError(0, f"record {name}: {fault}")
        self.records += 1
        self._got = 0
        self._head = OutputHead(name, size, typed)
        return self._head

    def _end_record(self) -> None:
        head, self._head = self._head, None
        if head is not None and head.size is not None and self._got != head.size:
            raise ProtocolError(
                0, f"record {head.name} ends after {self._got} of {head.size} bytes"
            )
