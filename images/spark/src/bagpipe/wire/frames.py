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
# The part that the checksum covers: magic, version, type and flags as one, length, sequence.
_CHECKED = struct.Struct("<8sII")
_CHECKED_HEADER_BYTES = 16
_CHECKSUM = struct.Struct("<I")
# Below it copying costs less than a second call.
_SMALL_PAYLOAD_BYTES = 8 * 1024
# Most sessions send small frames; the large buffer holds a whole frame and a good part of the next.
_SMALL_BUFFER_BYTES = 64 * 1024
_LARGE_BUFFER_BYTES = 2 * MAX_PAYLOAD_BYTES
# A DATA frame above it can be received without a copy, see `Decoder.missing`. At its end no more
# is read into the buffer than the heads of the frames that follow: they would be copied.
_LARGE_PAYLOAD_BYTES, _HEADS_BYTES = 256 * 1024, 4 * 1024
# A program that dribbles must not leave an object for every few bytes of a frame.
_CRUMB_BYTES = 4 * 1024
# Below this much space a read would bring little: the unfinished frame moves to the front.
_LEAST_SPACE_BYTES = 16 * 1024


class FrameType(enum.IntEnum):
    """What a frame's payload is."""

    HELLO = 1
    FILE = 2
    DATA = 3
    RESULT = 4
    METRIC = 5
    END = 6
    ABORT = 7
    STEP = 8
    ANSWER = 9


_TYPES = {int(kind): kind for kind in FrameType}
# What a right frame begins with, by type and back: one look instead of four comparisons.
_PREFIXES = {kind: struct.pack("<4sBBH", MAGIC, VERSION, kind, 0) for kind in FrameType}
_KINDS = {prefix: kind for kind, prefix in _PREFIXES.items()}


class ProtocolError(Exception):
    """Bytes that are no frame of this session, with the stream's offset where they begin."""

    def __init__(self, offset: int, message: str) -> None:
        super().__init__(f"frame at byte {offset} of the pipe: {message}")
        self.offset = offset


class BrokenStreamError(ProtocolError):
    """Bytes that don't go on with the stream: damaged, or of another sender than before."""


@dataclass(slots=True)
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


def payloads(data: bytes | memoryview) -> Iterator[bytes | memoryview]:
    """Data as payloads of frames, without a copy; what fits into one frame is left as it is."""
    if len(data) > MAX_PAYLOAD_BYTES:
        data = memoryview(data)
    for at in range(0, len(data), MAX_PAYLOAD_BYTES):
        yield data[at : at + MAX_PAYLOAD_BYTES]


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
        head = _CHECKED.pack(_PREFIXES[kind], len(payload), self._sequence)
        checksum = _CHECKSUM.pack(_checksum(head, payload))
        self._sequence = (self._sequence + 1) & 0xFFFFFFFF
        self._digest = google_crc32c.extend(self._digest, checksum)
        return head + checksum, payload

    def encode_fields(self, kind: FrameType, fields: dict[str, Any]) -> bytes:
        """The whole next frame of a type that carries a map."""
        head, payload = self.encode(kind, msgpack.packb(fields))
        return head + payload


class Decoder:
    """Frames out of a stream that arrives in pieces of any size.

    Holds one buffer that grows to two frames at most. Bytes come in by `feed`, or without a copy
    by reading into `space()` and passing their number to `received`. The rest of a large DATA
    frame, of which `missing` bytes are still to come, may instead be given to `rest` as it is.
    """

    def __init__(self) -> None:
        self._buffer = bytearray(_SMALL_BUFFER_BYTES)
        self._begin = 0
        self._end = 0
        self._offset = 0
        self._sequence = 0
        self._digest = 0
        self._digest_before = 0
        self._rest: list[bytes] = []
        self._crumbs = bytearray()
        self._rest_bytes = 0
        self._large_before = False

    @property
    def missing(self) -> int:
        """Bytes to come of a large DATA frame that has begun; 0 where there is none."""
        if self.pending < HEADER_BYTES:
            return 0
        prefix, length, _ = _CHECKED.unpack_from(self._buffer, self._begin)
        if length < _LARGE_PAYLOAD_BYTES or _KINDS.get(prefix) is not FrameType.DATA:
            return 0
        return int(HEADER_BYTES + length - self.pending)

    @property
    def digest_before_last(self) -> int:
        """The digest over all frames but the newest: what an END just received must carry."""
        return self._digest_before

    @property
    def pending(self) -> int:
        """Bytes of an unfinished frame."""
        return self._end - self._begin + self._rest_bytes

    def feed(self, data: bytes) -> Iterator[Frame]:
        """The frames that `data` completes. Raises ProtocolError at the first wrong frame."""
        rest = memoryview(data)
        while rest:
            space = self.space()
            count = min(len(space), len(rest))
            space[:count] = rest[:count]
            rest = rest[count:]
            yield from self.received(count)

    def space(self) -> memoryview:
        """Where the next bytes of the stream belong; at least one byte long.

        Release it, or let it go, before the next call.
        """
        if self._begin == self._end:
            self._begin = self._end = 0
        elif len(self._buffer) - self._end < _LEAST_SPACE_BYTES:
            self._make_room()
        between = self._large_before and self._end - self._begin < HEADER_BYTES
        end = self._end + _HEADS_BYTES if between else None
        return memoryview(self._buffer)[self._end : end]

    def received(self, count: int) -> Iterator[Frame]:
        """The frames that `count` more bytes complete. Raises ProtocolError as `feed` does."""
        self._end += count
        with memoryview(self._buffer) as view:
            while self._end - self._begin >= HEADER_BYTES:
                body = self._begin + HEADER_BYTES
                head = bytes(view[self._begin : body])
                kind, length = self._check_header(head)
                if self._end - body < length:
                    return
                frame = self._take(kind, head, bytes(view[body : body + length]))
                self._begin = body + length
                self._large_before = self._large_before and kind is not FrameType.DATA
                yield frame

    def rest(self, piece: bytes) -> list[bytes]:
        """The payload of the frame that `piece` completes, in pieces; empty while bytes miss.

        Takes `missing` bytes at most. Raises ProtocolError as `feed` does.
        """
        left = self.missing - len(piece)
        self._rest_bytes += len(piece)
        crumb = len(piece) < _CRUMB_BYTES
        if crumb:
            self._crumbs += piece
        if self._crumbs and not (crumb and left):
            self._rest.append(bytes(self._crumbs))
            self._crumbs.clear()
        if not crumb:
            self._rest.append(piece)
        if left:
            return []
        body = self._begin + HEADER_BYTES
        head = bytes(memoryview(self._buffer)[self._begin : body])
        first = bytes(memoryview(self._buffer)[body : self._end])
        pieces = [first, *self._rest] if first else self._rest
        actual = google_crc32c.value(head[:_CHECKED_HEADER_BYTES])
        for part in pieces:
            actual = google_crc32c.extend(actual, part)
        self._accept(head, actual, sum(map(len, pieces)))
        self._rest, self._rest_bytes, self._begin, self._end = [], 0, 0, 0
        self._large_before = True
        return pieces

    def _make_room(self) -> None:
        pending = self._end - self._begin
        view = memoryview(self._buffer)
        view[:pending] = view[self._begin : self._end]
        self._begin, self._end = 0, pending
        if len(self._buffer) == _SMALL_BUFFER_BYTES and pending > _SMALL_BUFFER_BYTES // 2:
            self._buffer = bytearray(_LARGE_BUFFER_BYTES)
            self._buffer[:pending] = view[:pending]

    def _check_header(self, head: bytes) -> tuple[FrameType, int]:
        prefix, length, sequence = _CHECKED.unpack_from(head)
        kind = _KINDS.get(prefix)
        if kind is None or sequence != self._sequence or not _fits(kind, length):
            raise BrokenStreamError(self._offset, _header_fault(head, self._sequence))
        return kind, length

    def _take(self, kind: FrameType, head: bytes, payload: bytes) -> Frame:
        frame = Frame(kind, 0, self._sequence, payload)
        self._accept(head, _checksum(head[:_CHECKED_HEADER_BYTES], payload), len(payload))
        return frame

    def _accept(self, head: bytes, actual: int, length: int) -> None:
        written = head[_CHECKED_HEADER_BYTES:]
        if written != _CHECKSUM.pack(actual):
            (checksum,) = _CHECKSUM.unpack(written)
            why = f"crc32c {checksum:#010x}, expected {actual:#010x}"
            raise BrokenStreamError(self._offset, why)
        self._offset += HEADER_BYTES + length
        self._sequence = (self._sequence + 1) & 0xFFFFFFFF
        self._digest_before = self._digest
        self._digest = google_crc32c.extend(self._digest, written)


def _fits(kind: FrameType, length: int) -> bool:
    return length <= MAX_PAYLOAD_BYTES and (length > 0 or kind is not FrameType.DATA)


def _header_fault(head: bytes, expected: int) -> str:
    """The first field that is wrong, in the order of the fields."""
    magic, version, kind, flags, length, sequence, _ = _HEADER.unpack(head)
    if magic != MAGIC:
        return f"magic {magic.hex()}, expected {MAGIC.hex()}"
    if version != VERSION:
        return f"version {version}, expected {VERSION}"
    if kind not in _TYPES:
        return f"type {kind}, expected 1 to {max(FrameType)}"
    if flags:
        return f"flags {flags:#06x}, expected 0"
    if not _fits(_TYPES[kind], length):
        least = 1 if kind == FrameType.DATA else 0
        return f"length {length}, expected {least} to {MAX_PAYLOAD_BYTES}"
    return f"sequence {sequence}, expected {expected}"


def _checksum(head: bytes, payload: bytes | memoryview) -> int:
    if len(payload) < _SMALL_PAYLOAD_BYTES:
        return int(google_crc32c.value(head + payload))
    # The library takes nothing but bytes; for them `bytes` is no copy.
    return int(google_crc32c.extend(google_crc32c.value(head), bytes(payload)))
