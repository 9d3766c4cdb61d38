"""The stamps of a case's inputs in a short time, read from the few chunks that hold it.

A criterion asks in doubt alone, and does without what would take long to read.
"""

import logging
from collections.abc import Callable, Iterator
from typing import Any

from bagpipe.evaluate.decoding import first_stamp_reader
from bagpipe.evaluate.evidence import ForTypes
from bagpipe.plan.bag_tail import Chunk, read_tail
from bagpipe.plan.case import Case
from bagpipe.plan.fragments import near
from bagpipe.plan.framing import framed
from bagpipe.recording_format import in_memory
from bagpipe.storage import OpenFile, Storage, StorageError
from bagpipe.storage.reading import REQUEST_BYTES, requests
from bagpipe.topic_names import resolve

# Of one chunk, as it is stored and again as it is uncompressed.
_MOST_CHUNK_BYTES = 16 << 20
_MOST_CHUNKS = 256
# Each brings 4 MiB at most, and object storage answers it within some 20 ms.
_MOST_REQUESTS = 30
_MOST_INPUTS = 200_000
# Of what is declared before all chunks, which is read with each of them.
_MOST_HEAD_BYTES, _MOST_CONNECTIONS = 4 << 20, 2_000
# The end of each takes half a dozen reads.
_MOST_FILES = 64

log = logging.getLogger(__name__)

Stamps = dict[str, list[tuple[int, int]]]
StampReader = Callable[[memoryview], int | None]


class _UnknownError(Exception):
    """The stamps can't be known, or not by few reads."""


def stamps_in(case: Case, topics: list[str], storage: Storage, begin: int, end: int) -> Stamps:
    """Of each topic whose messages begin with a header (`topics`: none is all), the (time, stamp)
    in ns of the inputs that were played with begin <= time < end; of others nothing.

    Nothing where the recording is damaged, has no chunks that can be read alone, or too many of
    them in that time. Raises StorageError.
    """
    begin = max(begin, case.window.lead_in_start)
    named = [(part.bag, part.version) for part in case.parts] or [(case.bag, case.bag_version)]
    found: Stamps = {}
    try:
        if len(named) > _MOST_FILES:
            raise _UnknownError
        files = [_File(storage.open(*each), topics, begin, end) for each in named]
        _check(files)
        count = 0
        for file in files:
            for topic, time, stamp in file.stamps(begin, end):
                found.setdefault(topic, []).append((time, stamp))
                count += 1
                if count > _MOST_INPUTS:  # whatever the index states
                    raise _UnknownError
    except StorageError:
        raise
    except Exception:  # a doubt that can't be followed must not make a case invalid
        log.info("no stamps of the inputs of case %s", case.id, exc_info=True)
        return {}
    return found


def _check(files: "list[_File]") -> None:
    """Raises _UnknownError where they have together more than is read."""
    for count, most in (
        (sum(file.requests for file in files), _MOST_REQUESTS),
        (sum(file.inputs for file in files), _MOST_INPUTS),
        (sum(file.head_bytes for file in files), _MOST_HEAD_BYTES),
    ):
        if count > most:
            raise _UnknownError


class _File:
    """A bag or a file of MCAP, with its chunks that may have inputs with a header in a time."""

    def __init__(self, file: OpenFile, topics: list[str], begin: int, end: int) -> None:
        self._file = file
        tail = self._tail = read_tail(file.read, file.size)
        asked = [each for each in tail.connections if not topics or resolve(each.topic) in topics]
        self._wanted = {each.id for each in asked}
        self._chunks = near(tail, self._wanted, begin, end)
        # A chunk may have more topics than the index shows.
        if not tail.counted or self._is_too_much():
            raise _UnknownError
        there = {at for chunk in self._chunks for at in chunk.counts}
        self._topics = {resolve(each.topic) for each in asked if each.id in there}

    def _is_too_much(self) -> bool:
        return (
            len(self._chunks) > _MOST_CHUNKS
            or any(size > _MOST_CHUNK_BYTES for _, size in self._ranges)
            or len(self._tail.connections) > _MOST_CONNECTIONS
        )

    @property
    def head_bytes(self) -> int:
        """Of what it declares, which is read where it has a chunk in that time."""
        return sum(size for _, size in self._tail.declarations) if self._chunks else 0

    @property
    def _ranges(self) -> list[tuple[int, int]]:
        return [(chunk.offset, chunk.end - chunk.offset) for chunk in self._chunks]

    @property
    def requests(self) -> int:
        """How many its chunks take at the most."""
        return sum(1 for _ in requests(self._ranges, REQUEST_BYTES, 0))

    @property
    def inputs(self) -> int:
        """How many its chunks have at the most."""
        counts = (chunk.counts for chunk in self._chunks)
        return sum(count for each in counts for at, count in each.items() if at in self._wanted)

    def stamps(self, begin: int, end: int) -> Iterator[tuple[str, int, int]]:
        """Topic, time and stamp of each, with one chunk in memory at a time.

        Raises BagError, ValueError and StorageError.
        """
        if not self._chunks:
            return
        head = b"".join(self._file.pieces(self._tail.declarations, REQUEST_BYTES))
        declared = self._opened(head, [], b"").connections
        readers = _readers([each for each in declared if resolve(each.topic) in self._topics])
        for chunk, stored in self._stored():
            opened = self._opened(head, [chunk], stored)
            names = [each.topic for each in opened.connections if each.id in readers]
            for connection, time, raw in opened.messages(names, begin, end):
                stamp = readers[connection.id](raw)
                if stamp is not None:
                    yield resolve(connection.topic), time, stamp
            if opened.damage is not None:
                raise _UnknownError

    def _stored(self) -> Iterator[tuple[Chunk, bytes]]:
        """Each chunk with its bytes; those that lie together are read together."""
        pieces = self._file.pieces(self._ranges, REQUEST_BYTES)
        for chunk, (_, size) in zip(self._chunks, self._ranges, strict=True):
            stored = b""
            while len(stored) < size:
                stored += next(pieces)
            yield chunk, stored

    def _opened(self, head: bytes, chunks: list[Chunk], stored: bytes) -> Any:
        ranges = self._tail.declarations + [(each.offset, len(stored)) for each in chunks]
        # What the index states of the chunks' times was compared when they were played.
        return in_memory(b"".join(framed(ranges, [head, stored])), _MOST_CHUNK_BYTES)


def _readers(connections: list[Any]) -> dict[int, StampReader]:
    """By connection, of the topics of which each publisher's messages begin with a header."""
    readers = ForTypes(first_stamp_reader)
    found = {each.id: readers.of(each) for each in connections}
    without = {resolve(each.topic) for each in connections if found[each.id] is None}
    return {
        each.id: reader
        for each in connections
        if (reader := found[each.id]) is not None and resolve(each.topic) not in without
    }
