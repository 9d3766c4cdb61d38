"""The pipe's frames and their codec; nothing here opens or waits (docs/reference/binpipe.md)."""

import enum
import struct
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import google_crc32c
import msgpack

MAGIC = b"BPIP"
VERSION = 1
HEADER_BYTES = 20
MAX_PAYLOAD_BYTES = 1 << 20

_HEADER = struct.Struct("<4sBBHIII")
_CHECKED_HEADER_BYTES = 16


class FrameType(enum.IntEnum):
    """What a frame's payload is."""

    HELLO = 1
    FILE = 2
    DATA = 3
    RESULT = 4
    METRIC = 5
    END = 6
    ABORT = 7


class ProtocolError(Exception):
    """Bytes that are no frame of this session, with the stream's offset where they begin."""

    def __init__(self, offset: int, message: str) -> None:
        super().__init__(f"frame at byte {offset} of the pipe: {message}")
        self.offset = offset


@dataclass(frozen=True)
class Frame:
    """One frame as received; `payload` is 0 to 1,048,576 bytes."""

    type: FrameType
    flags: int
    sequence: int
    payload: bytes

    def fields(self) -> dict[str, Any]:
        """The payload as the MessagePack map that every type but DATA carries.

        Raises ProtocolError where it is not one.
        """
        try:
            value = msgpack.unpackb(self.payload, strict_map_key=True)
        except (ValueError, msgpack.UnpackException) as error:
            raise ProtocolError(0, f"{self.type.name} is not MessagePack: {error}") from error
        if not isinstance(value, dict):
            raise ProtocolError(0, f"{self.type.name} holds {type(value).__name__}, expected a map")
        return value


class Encoder:
    """Numbers and checks the frames of one direction of a session."""

    def __init__(self) -> None:
        self._sequence = 0
        self._digest = 0

    @property
    def digest(self) -> int:
        """CRC-32C over the checksums of all frames so far, as END carries it."""
        return self._digest

    def encode(
        self, kind: FrameType, payload: bytes | memoryview
    ) -> tuple[bytes, bytes | memoryview]:
        """The next frame's header and payload, not joined, so that big payloads are not copied."""
        if len(payload) > MAX_PAYLOAD_BYTES:
            raise ValueError(f"a {kind.name} payload of {len(payload)} bytes is above 1 MiB")
        head = _HEADER.pack(MAGIC, VERSION, kind, 0, len(payload), self._sequence, 0)
        checksum = _checksum(head[:_CHECKED_HEADER_BYTES], payload)
        self._sequence += 1
        self._digest = _extend_digest(self._digest, checksum)
        return head[:_CHECKED_HEADER_BYTES] + struct.pack("<I", checksum), payload

    def encode_fields(self, kind: FrameType, fields: dict[str, Any]) -> bytes:
        """The whole next frame of a type that carries a map."""
        head, payload = self.encode(kind, msgpack.packb(fields))
        return head + bytes(payload)


class Decoder:
    """Frames out of a stream that arrives in pieces of any size; holds at most one frame."""

    def __init__(self) -> None:
        self._buffer = bytearray()
        self._offset = 0
        self._sequence = 0
        self._digest = 0
        self._digest_before = 0

    @property
    def digest_before_last(self) -> int:
        """The digest over all frames but the newest: what an END just received must carry."""
        return self._digest_before

    @property
    def pending(self) -> int:
        """Bytes of an unfinished frame."""
        return len(self._buffer)

    def feed(self, data: bytes) -> Iterator[Frame]:
        """The frames that `data` completes. Raises ProtocolError at the first wrong frame."""
        self._buffer += data
        while len(self._buffer) >= HEADER_BYTES:
            length, checksum = self._check_header()
            if len(self._buffer) < HEADER_BYTES + length:
                return
            yield self._take(length, checksum)

    def _check_header(self) -> tuple[int, int]:
        magic, version, kind, flags, length, sequence, checksum = _HEADER.unpack_from(self._buffer)
        wrong = _header_fault(magic, version, kind, flags, length)
        if wrong is None and sequence != self._sequence:
            wrong = f"sequence {sequence}, expected {self._sequence}"
        if wrong is not None:
            raise ProtocolError(self._offset, wrong)
        return length, checksum

    def _take(self, length: int, checksum: int) -> Frame:
        payload = bytes(memoryview(self._buffer)[HEADER_BYTES : HEADER_BYTES + length])
        actual = _checksum(bytes(self._buffer[:_CHECKED_HEADER_BYTES]), payload)
        if actual != checksum:
            raise ProtocolError(self._offset, f"crc32c {checksum:#010x}, expected {actual:#010x}")
        kind, flags, sequence = self._buffer[5], 0, self._sequence
        del self._buffer[: HEADER_BYTES + length]
        self._offset += HEADER_BYTES + length
        self._sequence += 1
        self._digest_before = self._digest
        self._digest = _extend_digest(self._digest, checksum)
        return Frame(FrameType(kind), flags, sequence, payload)


def _header_fault(magic: bytes, version: int, kind: int, flags: int, length: int) -> str | None:
    if magic != MAGIC:
        return f"magic {magic.hex()}, expected {MAGIC.hex()}"
    if version != VERSION:
        return f"version {version}, expected {VERSION}"
    if kind not in FrameType.__members__.values():
        return f"type {kind}, expected 1 to {max(FrameType)}"
    if flags:
        return f"flags {flags:#06x}, expected 0"
    least = 1 if kind == FrameType.DATA else 0
    if not least <= length <= MAX_PAYLOAD_BYTES:
        return f"length {length}, expected {least} to {MAX_PAYLOAD_BYTES}"
    return None


def _checksum(head: bytes, payload: bytes | memoryview) -> int:
    checksum = google_crc32c.value(head)
    return int(google_crc32c.extend(checksum, bytes(payload))) if len(payload) else int(checksum)


def _extend_digest(digest: int, checksum: int) -> int:
    return int(google_crc32c.extend(digest, struct.pack("<I", checksum)))
