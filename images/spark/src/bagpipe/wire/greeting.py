"""Finding the agent's first frame of our session behind what a dead worker left in the pipe.

docs/reference/binpipe.md, "After a session that broke off".
"""

from bagpipe.wire.frames import (
    HEADER_BYTES,
    MAGIC,
    MAX_PAYLOAD_BYTES,
    Decoder,
    Frame,
    FrameType,
    ProtocolError,
)

# Leftovers are at most what a pipe and one cut frame hold; more than this is never kept.
_MAX_KEPT_BYTES = 2 * (MAX_PAYLOAD_BYTES + HEADER_BYTES)


class Greeting:
    """Throws away bytes until a HELLO, or an ABORT, that names our session."""

    def __init__(self, session: str) -> None:
        self._session = session
        self._kept = bytearray()
        self.discarded = 0

    def feed(self, data: bytes) -> bytes | None:
        """The stream from our first frame on, or None while it has not come."""
        self._kept += data
        at = self._kept.find(MAGIC)
        while at >= 0:
            frame = _first_frame(bytes(self._kept[at:]))
            if frame is not None and self._is_ours(frame):
                self.discarded += at
                return bytes(self._kept[at:])
            at = self._kept.find(MAGIC, at + 1)
        surplus = max(0, len(self._kept) - _MAX_KEPT_BYTES)
        del self._kept[:surplus]
        self.discarded += surplus
        return None

    def _is_ours(self, frame: Frame) -> bool:
        if frame.type not in (FrameType.HELLO, FrameType.ABORT):
            return False
        try:
            return frame.fields().get("session") == self._session
        except ProtocolError:
            return False


def _first_frame(data: bytes) -> Frame | None:
    """The frame at the beginning of `data`, None where it is cut or none."""
    try:
        return next(Decoder().feed(data), None)
    except ProtocolError:
        return None
