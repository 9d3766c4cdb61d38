"""Frames in and out of blocking descriptors (docs/reference/binpipe.md, "Frame")."""

import os
import struct
from collections.abc import Callable

MAX_PAYLOAD_BYTES = 1 << 20
HELLO, FILE, DATA, END, ABORT = 1, 2, 3, 6, 7
# The part that the checksum covers: magic, version, type and flags as one, length, sequence.
_CHECKED, _CHECKSUM = struct.Struct("<8sII"), struct.Struct("<I")
_PREFIXES = {kind: struct.pack("<4sBBH", b"BPIP", 1, kind, 0) for kind in range(HELLO, ABORT + 1)}
_KINDS = {prefix: kind for kind, prefix in _PREFIXES.items()}
# Below it copying costs less than a second call.
_SMALL_BYTES = 8 * 1024
_HEADER_BYTES, _CHECKED_BYTES = 20, 16
# Of a large frame no more is read than itself and the head of the next: the beginning of that
# would have to be moved. Several small ones come in one read.
_LARGE_BYTES, _BEYOND_BYTES = 256 * 1024, 4 * 1024
# Small frames leave together; `writev` takes 1,024 pieces at most.
_FLUSH_BYTES, _FLUSH_PIECES = 256 * 1024, 512


class BinpipeError(Exception):
    """The stream can't go on; the sentence says why."""


class Outgoing:
    """Numbers, checks and writes the program's frames."""

    def __init__(self, descriptor: int) -> None:
        self._descriptor = descriptor
        self._pending: list[bytes | memoryview] = []
        self._pending_bytes = 0
        self._sequence = 0
        self.digest = 0

    def send(self, kind: int, payload: bytes) -> None:
        """The next frame; it leaves when enough has come together or the program waits."""
        head = _CHECKED.pack(_PREFIXES[kind], len(payload), self._sequence)
        if len(payload) < _SMALL_BYTES:
            head += _CHECKSUM.pack(extend_crc(0, head + payload))
        else:
            head += _CHECKSUM.pack(extend_crc(extend_crc(0, head), payload))
        self._sequence = (self._sequence + 1) & 0xFFFFFFFF
        self.digest = extend_crc(self.digest, head[_CHECKED_BYTES:])
        self._pending += (head, payload)
        self._pending_bytes += len(payload)
        if self._pending_bytes >= _FLUSH_BYTES or len(self._pending) >= _FLUSH_PIECES:
            self.flush()

    def flush(self) -> None:
        """Write what is pending."""
        pending, self._pending, self._pending_bytes = self._pending, [], 0
        first = 0
        while first < len(pending):
            written = os.writev(self._descriptor, pending[first:])
            while first < len(pending) and written >= len(pending[first]):
                written -= len(pending[first])
                first += 1
            if written:
                pending[first] = memoryview(pending[first])[written:]


class Incoming:
    """The worker's frames; what is wrong with one is a BinpipeError with its offset."""

    def __init__(self, descriptor: int, before_waiting: Callable[[], None]) -> None:
        self._descriptor = descriptor
        self._before_waiting = before_waiting
        self._buffer = bytearray(2 * MAX_PAYLOAD_BYTES)
        self._view = memoryview(self._buffer)
        self._begin = self._end = self._offset = self._sequence = self.digest = 0
        self._put_back: tuple[int, bytes] | None = None

    def put_back(self, kind: int, payload: bytes) -> None:
        """Let `next` give this frame once more."""
        self._put_back = kind, payload

    def next(self) -> tuple[int, bytes] | None:
        """(type, payload), None at the end of the stream."""
        if self._put_back is not None:
            frame, self._put_back = self._put_back, None
            return frame
        if not self._fill(_HEADER_BYTES):
            return None
        prefix, length, sequence = _CHECKED.unpack_from(self._buffer, self._begin)
        kind = _KINDS.get(prefix, 0)
        fits = (1 if kind == DATA else 0) <= length <= MAX_PAYLOAD_BYTES
        if not kind or not fits or sequence != self._sequence:
            raise BinpipeError(f"byte {self._offset} of the input holds no frame of this session")
        if not self._fill(_HEADER_BYTES + length):
            raise self._cut()
        at = self._begin
        payload = bytes(self._view[at + _HEADER_BYTES : at + _HEADER_BYTES + length])
        head = bytes(self._view[at : at + _HEADER_BYTES])
        checksum = head[_CHECKED_BYTES:]
        if length < _SMALL_BYTES:
            actual = extend_crc(0, head[:_CHECKED_BYTES] + payload)
        else:
            actual = extend_crc(extend_crc(0, head[:_CHECKED_BYTES]), payload)
        if _CHECKSUM.pack(actual) != checksum:
            raise BinpipeError(f"the frame at byte {self._offset} of the input is damaged")
        if kind != END:
            self.digest = extend_crc(self.digest, checksum)
        self._begin += _HEADER_BYTES + length
        self._offset += _HEADER_BYTES + length
        self._sequence = (self._sequence + 1) & 0xFFFFFFFF
        return kind, payload

    def _fill(self, least: int) -> bool:
        while self._end - self._begin < least:
            if self._begin == self._end:
                self._begin = self._end = 0
            elif len(self._buffer) - self._begin < least:
                pending = self._end - self._begin
                self._view[:pending] = self._view[self._begin : self._end]
                self._begin, self._end = 0, pending
            self._before_waiting()
            end = self._begin + least + _BEYOND_BYTES if least > _LARGE_BYTES else None
            count = os.readv(self._descriptor, [self._view[self._end : end]])
            if count:
                self._end += count
            elif self._end > self._begin:
                raise self._cut()
            else:
                return False
        return True

    def _cut(self) -> BinpipeError:
        return BinpipeError(f"the input is cut in the frame at byte {self._offset}")


def _table() -> list[int]:
    table = []
    for number in range(256):
        value = number
        for _ in range(8):
            value = value >> 1 ^ 0x82F63B78 * (value & 1)
        table.append(value)
    return table


_TABLE = _table()


def slow_crc(checksum: int, data: bytes) -> int:
    """CRC-32C (Castagnoli) in Python alone, continued from `checksum`."""
    value = checksum ^ 0xFFFFFFFF
    for byte in data:
        value = value >> 8 ^ _TABLE[(value ^ byte) & 0xFF]
    return value ^ 0xFFFFFFFF


extend_crc: Callable[[int, bytes], int] = slow_crc
try:
    import google_crc32c

    extend_crc = google_crc32c.extend
except ImportError:
    pass
