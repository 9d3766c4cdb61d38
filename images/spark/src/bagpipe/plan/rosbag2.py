"""A folder of rosbag2 as one recording: which bytes of which of its files hold which times.

Its files are planned as if they lay one behind the other in a single file: a place in that is a
file's own offset behind where the file begins. So fragments are cut over the whole recording, and
one may need parts of several files. A file of MCAP is read by ranges; one of SQLite, or one that
was compressed as a whole, is read whole, and its parts have one range: all of it.
"""

import bisect
import contextlib
import hashlib
import json
import posixpath
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial

from bagpipe.native import native
from bagpipe.plan.bag_tail import BagError, BagTail, Chunk, Connection, message_times, read_tail
from bagpipe.plan.fragments import FragmentPlan, Times, Window, ranges_of
from bagpipe.plan.framing import framed
from bagpipe.plan.in_force import Late
from bagpipe.plan.part import Part
from bagpipe.plan.rosbag2_metadata import METADATA, Metadata, is_folder, read_metadata
from bagpipe.plan.rosbag2_whole import MOST_TIMES, read_whole, whole_file
from bagpipe.plan.stated_times import stated_by
from bagpipe.storage import OpenFile, Storage, StorageError
from bagpipe.storage.globs import fixed_folder, is_of_one_folder, is_pattern, matcher
from bagpipe.topic_names import resolve

# The names that files of recordings end in.
_OF_FILES = frozenset({".bag", ".mcap", ".db3"})
_ON_VOLUMES = ("pvc://", "file://")
# Of a fragment's bytes as they are stored, of each file, and again of what they hold uncompressed.
MOST_FRAGMENT_BYTES = 1 << 30
_PIECE_BYTES = 1 << 20


def in_folders(pattern: str, storage: Storage) -> list[str]:
    """The URIs that a pattern names, sorted: of files, or where it names or matches folders of
    rosbag2, of their metadata. Raises StorageError.
    """
    # On object storage there is no folder: there are names that begin alike.
    if pattern.endswith("/"):
        return storage.expand(f"{pattern}{METADATA}")
    found = storage.expand(pattern)
    if found == [pattern]:
        return found
    return sorted({*found, *_metadata_below(pattern, found, storage)})


def _metadata_below(pattern: str, files: list[str], storage: Storage) -> list[str]:
    """That of the folders that a pattern matches beside these files."""
    as_files = is_pattern(pattern) and posixpath.splitext(pattern)[1] in _OF_FILES
    if pattern.startswith(_ON_VOLUMES) or not (as_files and is_of_one_folder(pattern)):
        return storage.expand(f"{pattern}/{METADATA}")
    # Few folders are named as files are. What is in the others is not listed: there may be millions
    # of objects.
    above, matches = fixed_folder(pattern), matcher(pattern)
    beside = {f"{above}/{name}" for name in storage.names(above)} - set(files)
    found = [f"{uri}/{METADATA}" for uri in sorted(beside) if matches(uri)]
    return [uri for uri in found if storage.exists(uri)]


def without_members(uris: list[str], storage: Storage) -> list[str]:
    """The recordings without the files that a folder's metadata names, whichever links lead to
    these: they are none of their own, and would be played twice. Raises StorageError.
    """
    members: set[str] = set()
    own = storage.own_names(uris)
    folders = storage.own_names([uri.removesuffix(METADATA) for uri in filter(is_folder, uris)])
    ordered = sorted(set(own.values()))
    for given, folder in folders.items():
        # What begins alike stands together: the folder's own metadata, and maybe more.
        first = bisect.bisect_left(ordered, folder)
        metadata = f"{folder}{METADATA}"
        if any(each != metadata and each.startswith(folder) for each in ordered[first : first + 2]):
            # Who plans it says what is wrong.
            with contextlib.suppress(BagError, StorageError):
                files = read_metadata(f"{given}{METADATA}", storage).files
                members.update(storage.own_names(files).values())
    return [uri for uri in uris if own[uri] not in members]


@dataclass(frozen=True)
class _File:
    """One file, which begins at `base` of the recording; `channels` are its own connection ids."""

    file: OpenFile
    base: int
    tail: BagTail
    channels: dict[int, int]
    times: Times


class Rosbag2:
    """A folder that was looked at. `tail` is that of the whole recording.

    Of files that are read whole the times of at most `most_times` messages are kept.
    """

    def __init__(self, metadata: Metadata, storage: Storage, most_times: int | None = None) -> None:
        self.metadata = metadata
        left = MOST_TIMES if most_times is None else most_times
        self._files: list[_File] = []
        self._ids: dict[tuple[Connection, int], int] = {}
        self._chunks: dict[int, tuple[_File, Chunk]] = {}
        connections: dict[int, Connection] = {}
        chunks: list[Chunk] = []
        size = 0
        for uri in metadata.files:
            try:
                file, tail, times, kept = _opened(uri, metadata, storage, left)
            except BagError as error:
                if error.reason == "BagEmpty" and len(metadata.files) > 1:
                    continue
                raise BagError(error.reason, f"{posixpath.basename(uri)}: {error}") from error
            left -= kept
            channels = self._channels(tail)
            known = _File(file, size, tail, channels, times)
            self._files.append(known)
            for each in tail.connections:
                number = channels[each.id]
                connections.setdefault(number, replace(each, id=number))
            chunks += [self._moved(known, chunk) for chunk in tail.chunks]
            size += file.size
        counted = all(file.tail.counted for file in self._files)
        self.tail = BagTail(size, [], list(connections.values()), chunks, counted)
        self._bases = [file.base for file in self._files]
        self._places = sorted(self._chunks)
        if not chunks:
            raise BagError("BagEmpty", "its files hold no messages")

    @property
    def version(self) -> str:
        """The mark of its metadata, and behind it one that changes with any of its files, also with
        one that no part of a case is of: a truth may be in it.
        """
        marks = json.dumps([file.file.version for file in self._files])
        return f"{self.metadata.version}:{hashlib.sha256(marks.encode()).hexdigest()[:32]}"

    def times(self, chunk: Chunk) -> dict[int, list[int]]:
        """Times in ns of a chunk's messages, for each connection of the recording.

        Raises BagError where its file does not say them.
        """
        file, own = self._chunks[chunk.offset]
        times: dict[int, list[int]] = {}
        for number, found in file.times(own).items():
            times.setdefault(file.channels[number], []).extend(found)
        return times

    def parts(self, fragment: FragmentPlan, topics: list[str]) -> list[Part]:
        """What a fragment needs of each file, in their order."""
        needed: dict[int, list[Chunk]] = {}
        for offset, length in fragment.ranges:
            first = bisect.bisect_left(self._places, offset)
            for place in self._places[first : bisect.bisect_left(self._places, offset + length)]:
                at = bisect.bisect_right(self._bases, place) - 1
                needed.setdefault(at, []).append(self._chunks[place][1])
        return [
            self._part(self._files[at], chunks, fragment.window, topics)
            for at, chunks in needed.items()
        ]

    def _part(self, file: _File, chunks: list[Chunk], window: Window, topics: list[str]) -> Part:
        by_ranges = self.metadata.by_ranges
        wanted = {c.id for c in file.tail.connections if not topics or resolve(c.topic) in topics}
        near = [c for c in chunks if c.start_time < window.end]
        near = [c for c in near if c.end_time >= window.lead_in_start]
        return Part(
            bag=file.file.uri,
            version=file.file.version,
            topics=topics,
            window=window,
            at=window.start,
            connections=file.tail.declarations if by_ranges else [],
            ranges=ranges_of(chunks) if by_ranges else [(0, file.file.size)],
            messages=sum(n for c in near for k, n in c.counts.items() if k in wanted),
            stated=stated_by(chunks) if by_ranges else "",
        )

    def _channels(self, tail: BagTail) -> dict[int, int]:
        """A file's channels in the recording's numbers; such as several files declare alike are
        one, and of those that are alike in one file each is a publisher of its own.
        """
        alike: Counter[Connection] = Counter()
        numbers = {}
        for each in tail.connections:
            key = replace(each, id=0, offset=0, length=0)
            numbers[each.id] = self._ids.setdefault((key, alike[key]), len(self._ids))
            alike[key] += 1
        return numbers

    def _moved(self, file: _File, chunk: Chunk) -> Chunk:
        counts: dict[int, int] = {}
        for number, count in chunk.counts.items():
            counts[file.channels[number]] = counts.get(file.channels[number], 0) + count
        moved = replace(
            chunk,
            offset=file.base + chunk.offset,
            end=file.base + chunk.end,
            counts=counts,
        )
        self._chunks[moved.offset] = (file, chunk)
        return moved


def _opened(
    uri: str, metadata: Metadata, storage: Storage, most_times: int
) -> tuple[OpenFile, BagTail, Times, int]:
    """A file, and how many times of its messages are kept."""
    file, kept = storage.open(uri), 0
    times: Times
    if metadata.by_ranges:
        tail, times = read_tail(file.read, file.size), partial(message_times, file.read)
    else:
        with whole_file(file, metadata, storage) as path:
            whole = read_whole(path, metadata, file.size, most_times)
        tail, times, kept = whole.tail, whole.times_of, whole.kept
    encoded = [
        replace(each, encoding=metadata.encodings.get(each.topic) or each.encoding)
        for each in tail.connections
    ]
    return file, replace(tail, connections=encoded), times, kept


def joined(
    parts: Sequence[Part], metadata: Metadata, storage: Storage, late: Mapping[str, Late]
) -> bytes:
    """The parts as one file of MCAP: their topics in their window, and what was latched before it.

    `late` says of recorded topics what late subscribers get. Each file counts its channels by
    itself, so that one of several is written again, in memory. Raises BagError and StorageError.
    """
    window = parts[0].window
    with contextlib.ExitStack() as held:
        files = [
            _bytes_of(part, storage)
            if metadata.by_ranges
            else held.enter_context(
                whole_file(storage.open(part.bag, part.version), metadata, storage)
            )
            for part in parts
        ]
        join = native("joined_mcap", "reading a folder of rosbag2")
        try:
            made: bytes = join(
                files,
                metadata.text,
                window.lead_in_start,
                window.end,
                parts[0].topics,
                late={topic: (each.latching, each.depth) for topic, each in late.items()},
                memory=MOST_FRAGMENT_BYTES,
            )
        except ValueError as error:
            raise BagError("BagUnreadable", str(error)) from error
        return made


def _bytes_of(part: Part, storage: Storage) -> bytes:
    if part.bytes > MOST_FRAGMENT_BYTES:
        raise BagError(
            "BagUnreadable",
            f"the fragment needs {part.bytes:,} bytes of {part.bag}, above 1 GiB: choose shorter"
            " fragments",
        )
    sources = part.connections + part.ranges
    pieces = storage.pieces(part.bag, sources, _PIECE_BYTES, part.version)
    return b"".join(framed(sources, pieces, part.stated))
