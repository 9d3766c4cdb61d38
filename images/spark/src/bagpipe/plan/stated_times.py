"""The times and channels that chunks of MCAP state, as their recording's index has them and as they
do.

Chunks are planned by the index alone. One that states less time there than it has messages of, or
other channels, would lack in fragments that these belong to, and no one would know: so a digest of
what the index states goes with a fragment, and is compared with its chunks, and with the message
indexes behind them, as their bytes pass.
"""

import hashlib
import struct
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping

from bagpipe.plan.bag_tail import BagError, Chunk
from bagpipe.recording_format import MCAP_MAGIC

_CHUNK, _MESSAGE_INDEX = 0x06, 0x07
# A record's opcode and length; what a chunk's content begins with, its first and last time; and a
# message index's, its channel and the bytes of its entries, of 16 each.
_HEAD, _TIMES, _ENTRIES = struct.Struct("<BQ"), struct.Struct("<QQ"), struct.Struct("<HI")
_ENTRY_BYTES, _COUNT = 16, struct.Struct("<HQ")
_BEGINNINGS = {_CHUNK: _TIMES.size, _MESSAGE_INDEX: _ENTRIES.size}


def stated_by(chunks: Iterable[Chunk]) -> str:
    """The digest of what an index states of chunks, which lie in one file.

    Empty where nothing can be compared: chunks of bags state no times themselves.
    """
    found = hashlib.sha256()
    for chunk in sorted(chunks, key=lambda chunk: chunk.offset):
        if chunk.index is None:
            return ""
        found.update(_TIMES.pack(chunk.start_time, chunk.end_time))
        found.update(_of_channels(chunk.counts))
    return _short(found)


def compared(pieces: Iterable[bytes], stated: str) -> Iterator[bytes]:
    """The pieces of a file of MCAP from its magic on, of whose chunks an index has stated that.

    Raises BagError behind the last one.
    """
    found = _Passing()
    for piece in pieces:
        found.take(piece)
        yield piece
    if found.digest() != stated:
        raise BagError(
            "BagUnreadable",
            "a chunk states other times, or has messages of other channels, than the index in the"
            " summary, by which fragments are planned: write it again with chunks, message indexes"
            " and a summary (`bagpipe bag reindex BAG --to NEW`)",
        )


class _Passing:
    """Records that pass in pieces; of the contents of chunks the times alone are looked at."""

    def __init__(self) -> None:
        self._stated = hashlib.sha256()
        self._counts: Counter[int] = Counter()  # since the last chunk
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

    def digest(self) -> str:
        """Of all that has passed."""
        self._stated.update(_of_channels(self._counts))
        self._counts.clear()
        return _short(self._stated)

    def _record(self) -> None:
        op, length = _HEAD.unpack_from(self._head)
        content = self._head[_HEAD.size :]
        beginning = _BEGINNINGS.get(op, length + 1)
        if not content and length >= beginning:
            self._needed += beginning
            return
        if op == _CHUNK:
            self._stated.update(_of_channels(self._counts) + content)
            self._counts.clear()
        elif content:
            channel, entries = _ENTRIES.unpack(content)
            self._counts[channel] += entries // _ENTRY_BYTES
        self._skipped = length - len(content)
        self._head, self._needed = b"", _HEAD.size


def _of_channels(counts: Mapping[int, int]) -> bytes:
    """How many messages of each channel a chunk has."""
    return b"".join(_COUNT.pack(*each) for each in sorted(counts.items()) if each[1])


def _short(digest: "hashlib._Hash") -> str:
    return digest.hexdigest()[:16]
