"""Records over a pair of descriptors: the program's half of the protocol."""

import os
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from typing import Self

from .frames import ABORT, DATA, END, FILE, HELLO, MAX_PAYLOAD_BYTES, BinpipeError, Incoming
from .frames import Outgoing as _Outgoing
from .maps import pack, unpack

PROTOCOL = 1
_SOFTWARE = "bagpipe-binpipe python 0.2.0"

Field = str | int | bytes


class Record:
    """One input record. `size` is bytes, None where it is known at the end only.

    Its bytes are read once, in order, before the next record is asked for.
    """

    def __init__(self, pipe: "Pipe", name: str, size: int | None, fields: dict[str, Field]) -> None:
        self.name = name
        self.size = size
        self.fields = fields
        self._pipe = pipe
        self._rest = b""

    def pieces(self) -> Iterator[bytes]:
        """What is left of the record, at most 1 MiB at a time; memory stays small."""
        while piece := self._piece():
            yield piece

    def read(self, count: int = -1) -> bytes:
        """`count` bytes, fewer only at the end of the record; without a count all that is left."""
        if count < 0:
            return b"".join(self.pieces())
        found = []
        while count > 0 and (piece := self._piece()):
            found.append(piece[:count])
            self._rest = piece[count:]
            count -= len(found[-1])
        return b"".join(found)

    def _piece(self) -> bytes:
        if self._rest:
            piece, self._rest = self._rest, b""
            return piece
        return self._pipe.next_piece(self)


class Output:
    """One output record that is being written, see `create`."""

    def __init__(self, pipe: "Pipe") -> None:
        self._pipe = pipe
        self.bytes = 0

    def write(self, data: bytes | bytearray | memoryview) -> None:
        """Append bytes."""
        self.bytes += self._pipe.send_data(data)


class Pipe:
    """One session over two descriptors; the module's functions use that of stdin and stdout."""

    def __init__(self, read: int, write: int) -> None:
        self._output = _Outgoing(write)
        self._input = Incoming(read, self._output.flush)
        self._files = self._bytes = self._taken = 0
        self._current: Record | None = None
        self._name = ""
        self._input_digest: int | None = None
        hello = self._input.next()
        if hello is None or hello[0] != HELLO:
            raise BinpipeError("stdin holds no session: such a program is started by bin_piped")
        greeting = unpack(hello[1])
        if greeting.get("protocol") != PROTOCOL:
            raise BinpipeError(f"the worker speaks protocol {greeting.get('protocol')}, not 1")
        answer = {"session": greeting.get("session", ""), "protocol": 1, "software": _SOFTWARE}
        self._output.send(HELLO, pack(answer))

    @classmethod
    @contextmanager
    def over_fifos(cls, to_program: str, from_program: str) -> Iterator[Self]:
        """A session over named pipes, for a program that something else keeps running.

        Waits until a worker opens them. Ends the session when the block ends well.
        """
        read = os.open(to_program, os.O_RDONLY | os.O_CLOEXEC)
        write = -1
        try:
            write = os.open(from_program, os.O_WRONLY | os.O_CLOEXEC)
            pipe = cls(read, write)
            yield pipe
            pipe.close()
            while os.read(read, MAX_PAYLOAD_BYTES):
                pass
        finally:
            # In this order: at the end of from_program the worker may begin the next session,
            # which must not find this one's end of to_program open.
            os.close(read)
            if write >= 0:
                os.close(write)

    def read(self) -> Iterator[Record]:
        """The input records; what was left of one is skipped when the next is asked for."""
        while self._input_digest is None:
            if self._current is not None:
                for _ in self._current.pieces():
                    pass
            record = self._next_record()
            if record is not None:
                yield record

    def next_piece(self, record: Record) -> bytes:
        """The next bytes of a record, empty at its end."""
        if record is not self._current:
            return b""
        if record.size is None or self._taken < record.size:
            kind, payload = self._next()
            if kind == DATA:
                self._taken += len(payload)
                return payload
            self._input.put_back(kind, payload)
            if record.size is not None:
                raise BinpipeError(f"{record.name} ends at byte {self._taken} of {record.size}")
        self._current = None
        return b""

    def _next_record(self) -> Record | None:
        kind, payload = self._next()
        if kind == FILE:
            head = unpack(payload)
            self._taken = 0
            self._name = head["name"]
            self._current = Record(self, head["name"], head.get("size"), head.get("fields") or {})
            return self._current
        if kind != END:
            raise BinpipeError(f"a frame of type {kind} stands between two records")
        if unpack(payload).get("digest") != self._input.digest:
            raise BinpipeError("END of the input does not fit what came before it")
        self._input_digest = self._input.digest
        return None

    def _next(self) -> tuple[int, bytes]:
        frame = self._input.next()
        if frame is None:
            raise BinpipeError("the worker left before the end of its records")
        if frame[0] == ABORT:
            raise BinpipeError(f"the worker gave up: {unpack(frame[1]).get('message', '')}")
        return frame

    def write(
        self,
        data: bytes | bytearray | memoryview | Iterable[bytes],
        name: str | None = None,
        **fields: Field,
    ) -> None:
        """One output record; see the module's `write`."""
        if isinstance(data, (bytes, bytearray, memoryview)):
            size = len(data) if isinstance(data, bytes) else memoryview(data).nbytes
            self._begin(name, size, fields)
            self.send_data(data)
        else:
            with self.create(name, None, **fields) as output:
                for piece in data:
                    output.write(piece)

    @contextmanager
    def create(
        self, name: str | None = None, size: int | None = None, **fields: Field
    ) -> Iterator[Output]:
        """An output record to append to; with a size, exactly that many bytes must come."""
        name = self._begin(name, size, fields)
        output = Output(self)
        yield output
        if size is not None and output.bytes != size:
            raise BinpipeError(f"record {name} was to have {size} bytes, {output.bytes} came")

    def _begin(self, name: str | None, size: int | None, fields: dict[str, Field]) -> str:
        for key, value in fields.items():
            if isinstance(value, bool) or not isinstance(value, (str, int, bytes)):
                raise BinpipeError(f"field {key} is a {type(value).__name__}: use str, int, bytes")
            if isinstance(value, int) and not -(1 << 63) <= value < 1 << 63:
                raise BinpipeError(f"field {key} is {value}, which needs more than 64 bits")
        name = self._name if name is None else name
        head = pack({"name": name, "size": size, "fields": fields})
        if len(head) > MAX_PAYLOAD_BYTES:
            raise BinpipeError(f"name and fields of record {name[:100]} are above 1 MiB together")
        self._output.send(FILE, head)
        self._files += 1
        return name

    def send_data(self, data: bytes | bytearray | memoryview) -> int:
        """DATA frames of the record that is being written; the bytes they hold."""
        if isinstance(data, bytes) and 0 < len(data) <= MAX_PAYLOAD_BYTES:
            self._output.send(DATA, data)
            self._bytes += len(data)
            return len(data)
        view = memoryview(data)
        view = view.cast("B") if view.nbytes else memoryview(b"")
        for at in range(0, len(view), MAX_PAYLOAD_BYTES):
            self._output.send(DATA, bytes(view[at : at + MAX_PAYLOAD_BYTES]))
        self._bytes += len(view)
        return len(view)

    def flush(self) -> None:
        """Hand over what was written so far."""
        self._output.flush()

    def close(self, failure: BaseException | None = None) -> None:
        """End the output; give up for a failure, or for input that nobody asked for."""
        if failure is not None:
            message = f"{type(failure).__name__}: {failure}"[:4096]
            self._output.send(ABORT, pack({"reason": "Exception", "message": message}))
        elif self._input_digest is None:
            message = "the program ended before it had asked for all its records"
            self._output.send(ABORT, pack({"reason": "InputLeft", "message": message}))
        else:
            end = {"files": self._files, "bytes": self._bytes, "digest": self._output.digest}
            self._output.send(END, pack({**end, "input": self._input_digest}))
        self._output.flush()
