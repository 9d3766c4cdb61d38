"""The times that chunks of MCAP state, as their recording's index has them and as they do.

Chunks are planned by the index alone. One that states less time there than it has messages of
would lack in fragments that these belong to, and no one would know: so a digest of what the index
states goes with a fragment, and is compared with its chunks as their bytes pass.
"""

import hashlib
import struct
from collections.abc import Iterable, Iterator

from bagpipe.plan.bag_tail import BagError, Chunk
from bagpipe.recording_format import MCAP_MAGIC

_CHUNK = 0x06
# A record's opcode and length, and what a chunk's content begins with: its first and last time.
_HEAD, _TIMES = struct.Struct("<BQ"), struct.Struct("<QQ")


def stated_by(chunks: Iterable[Chunk]) -> str:
    """The digest of what an index states of chunks, which lie in one file.

    Empty where nothing can be compared: chunks of bags state no times themselves.
    """
    found = hashlib.sha256()
    for chunk in sorted(chunks, key=lambda chunk: chunk.offset):
        if chunk.index is None:
            return ""
        found.update(_TIMES.pack(chunk.start_time, chunk.end_time))
    return _short(found)


def compared(pieces: Iterable[bytes], stated: str) -> Iterator[bytes]:
    """The pieces of a file of MCAP from its magic on, of whose chunks an index has stated that.

    Raises BagError behind the last one.
    """
    found = _Passing()
    for piece in pieces:
        found.take(piece)
        yield piece
    if _short(found.times) != stated:
        raise BagError(
            "BagUnreadable",
            "a chunk states other times than the index in the summary, by which fragments are"
            " planned: write it again with chunks, message indexes and a summary (`mcap recover`)",
        )


class _Passing:
    """Records that pass in pieces; of the contents of chunks the times alone are looked at."""

    def __init__(self) -> None:
        self.times = hashlib.sha256()
        self._skipped = len(MCAP_MAGIC)
        self._head, self._needed = b"", _HEAD.size

    def take(self, piece: bytes) -> None:
        """The next bytes."""
        at = 0
        while at < len(piece):
            if self._skipped:
                skipped = min(self._skipped, len(piece) - at)
                self._skipped -= skipped
                at += skipped
                continue
            more = piece[at : at + self._needed - len(self._head)]
            self._head += more
            at += len(more)
            if len(self._head) == self._needed:
                self._record()

    def _record(self) -> None:
        op, length = _HEAD.unpack_from(self._head)
        content = self._head[_HEAD.size :]
        if op == _CHUNK and not content and length >= _TIMES.size:
            self._needed += _TIMES.size
            return
        self.times.update(content)
        self._skipped = length - len(content)
        self._head, self._needed = b"", _HEAD.size


def _short(digest: "hashlib._Hash") -> str:
    return digest.hexdigest()[:16]
