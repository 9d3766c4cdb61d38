"""The worker's half of a session: records as frames, written as the pipe takes them."""

import os
from collections import deque
from collections.abc import Iterable, Iterator

import bagpipe
from bagpipe.binpiped.record import InputRecord
from bagpipe.wire.frames import Encoder, FrameType, payloads

PROTOCOL = 1
# One writev carries small frames together; the kernel takes 1,024 pieces at most.
_BATCH_BYTES, _BATCH_PIECES = 256 * 1024, 512

Buffer = bytes | memoryview


class Sender:
    """Takes one record after the other; holds at most a batch of frames and one piece."""

    def __init__(self, session: str, records: Iterable[InputRecord]) -> None:
        self._encoder = Encoder()
        self._frames = self._outgoing(session, records)
        self._pending: deque[Buffer] = deque()
        self.active = True
        self.peer_gone = False
        self.records = 0
        self.bytes = 0
        self.current = ""
        # What the program's END must repeat, once our own END is on its way.
        self.digest: int | None = None

    @property
    def finished(self) -> bool:
        """Whether END is in the pipe, whole."""
        return not self.active and not self.peer_gone

    def send(self, descriptor: int) -> bool:
        """Write once; whether any byte went. Raises what the records' source raises."""
        if not self._pending and not self._refill():
            self.active = False
            return False
        try:
            written = os.writev(descriptor, self._pending)
        except BlockingIOError:
            return False
        except BrokenPipeError:
            # The program's ABORT, its exit or the end of its stream gives the reason.
            self.active = False
            self.peer_gone = True
            return False
        self._drop(written)
        if not self._pending and self.digest is not None:
            self.active = False
        return True

    def _refill(self) -> bool:
        size = 0
        for piece in self._frames:
            self._pending.append(piece)
            size += len(piece)
            if size >= _BATCH_BYTES or len(self._pending) >= _BATCH_PIECES:
                break
        return bool(self._pending)

    def _drop(self, written: int) -> None:
        pending = self._pending
        while pending and written >= len(pending[0]):
            written -= len(pending.popleft())
        if written:
            pending[0] = memoryview(pending[0])[written:]

    def _outgoing(self, session: str, records: Iterable[InputRecord]) -> Iterator[Buffer]:
        encoder = self._encoder
        software = f"bagpipe {bagpipe.__version__}"
        hello = {"session": session, "protocol": PROTOCOL, "software": software}
        yield encoder.encode_fields(FrameType.HELLO, hello)
        for record in records:
            self.current = record.name
            head = {"name": record.name, "size": record.size, "fields": dict(record.fields)}
            yield encoder.encode_fields(FrameType.FILE, head)
            for piece in record.pieces():
                for payload in payloads(piece):
                    yield from encoder.encode(FrameType.DATA, payload)
                self.bytes += len(piece)
            self.records += 1
        digest = encoder.digest
        end = {"files": self.records, "bytes": self.bytes, "digest": digest}
        frame = encoder.encode_fields(FrameType.END, end)
        self.digest = digest
        yield frame
