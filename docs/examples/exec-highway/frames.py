"""Bagpipe's frames on stdin and stdout (docs/reference/binpipe.md), as far as a program needs them.

A stream is HELLO, then for each file FILE and its DATA, then END. Every frame is 20 bytes of
header (magic, version, type, flags, length, number, checksum) and a payload.
"""

import struct
from collections.abc import Iterator
from typing import Any, BinaryIO

import google_crc32c
import msgpack

HELLO, FILE, DATA, RESULT, METRIC, END, ABORT = range(1, 8)
_HEADER = struct.Struct("<4sBBHIII")
_MAX_PAYLOAD = 1 << 20


def _checksum(data: bytes, before: int = 0) -> int:
    return int(google_crc32c.extend(before, data))


def read_files(stream: BinaryIO) -> Iterator[tuple[str, bytes]]:
    """Name and bytes of every file up to END. Raises ValueError for a stream that is none."""
    name, pieces, number = None, [], 0
    while True:
        header = stream.read(_HEADER.size)
        if len(header) < _HEADER.size:
            raise ValueError("stdin ended before END: start this program through Bagpipe")
        magic, version, kind, _, length, found, checksum = _HEADER.unpack(header)
        payload = stream.read(length)
        if (magic, version, found) != (b"BPIP", 1, number) or len(payload) < length:
            raise ValueError(f"frame {number} on stdin is none of this format")
        if _checksum(payload, _checksum(header[:16])) != checksum:
            raise ValueError(f"frame {number} on stdin has a wrong checksum")
        number += 1
        if kind == DATA:
            pieces.append(payload)
        elif kind in (FILE, END):
            if name is not None:
                yield name, b"".join(pieces)
            if kind == END:
                return
            name, pieces = msgpack.unpackb(payload)["name"], []


class Answer:
    """What goes back: files, and at the end a RESULT."""

    def __init__(self, stream: BinaryIO) -> None:
        self._stream = stream
        self._number = self._digest = self._files = self._bytes = 0

    def file(self, name: str, data: bytes) -> None:
        """Give a file back."""
        self._frame(FILE, msgpack.packb({"name": name, "size": len(data)}))
        for at in range(0, len(data), _MAX_PAYLOAD):
            self._frame(DATA, data[at : at + _MAX_PAYLOAD])
        self._files += 1
        self._bytes += len(data)

    def end(self, result: dict[str, Any]) -> None:
        """Say what came of it, and that nothing is missing."""
        self._frame(RESULT, msgpack.packb(result))
        end = {"files": self._files, "bytes": self._bytes, "digest": self._digest}
        self._frame(END, msgpack.packb(end))
        self._stream.flush()

    def _frame(self, kind: int, payload: bytes) -> None:
        head = _HEADER.pack(b"BPIP", 1, kind, 0, len(payload), self._number, 0)[:16]
        checksum = _checksum(payload, _checksum(head))
        self._stream.write(head + struct.pack("<I", checksum) + payload)
        self._digest = _checksum(struct.pack("<I", checksum), self._digest)
        self._number += 1
