"""Recordings that are no bags, for `bagpipe bag`: MCAP, and what rosbag2 writes.

The native module works on files of this machine: what lies elsewhere is copied here first, within a
budget, and of MCAP with an index only the parts that are needed.
"""

import contextlib
import tempfile
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from bagpipe.cli.bag_reading import BagFile, BagRefusedError, damage_data, times_of
from bagpipe.native import NativeModuleError, native
from bagpipe.plan.bag_tail import BagError, BagTail, read_tail
from bagpipe.plan.fragments import Window, cut_one
from bagpipe.plan.framing import framed
from bagpipe.plan.rosbag2_metadata import METADATA, is_folder, read_metadata
from bagpipe.recording_format import MCAP_MAGIC
from bagpipe.storage import Storage, StorageError

_PIECE_BYTES = 1 << 20
_MAGIC = {MCAP_MAGIC: "mcap", b"SQLite format 3\0": "database"}
_ADVICE = "`bagpipe bag reindex` writes it again with an index, which a job needs"


@dataclass(frozen=True)
class Written:
    """A recording that was made: its file's bytes, and what was lost of the old one."""

    data: bytes
    messages: int
    damage: dict[str, Any] | None = None
    # Fields of ROS 2 that a converted message did not have.
    added: tuple[str, ...] = ()


def kind_of(uri: str, storage: Storage) -> tuple[str, str]:
    """bag, mcap, database or folder; and the URI, which is that of its metadata for a folder.

    Raises StorageError.
    """
    if is_folder(uri):
        return "folder", uri
    inside = f"{uri.rstrip('/')}/{METADATA}"
    try:
        head = storage.open(uri).read(0, 16)
    except StorageError:
        if storage.exists(inside):
            return "folder", inside
        raise
    return next((kind for magic, kind in _MAGIC.items() if head.startswith(magic)), "bag"), uri


@dataclass(frozen=True)
class Elsewhere:
    """A recording of any format at a URI. Every method raises StorageError and BagRefusedError."""

    uri: str
    kind: str
    storage: Storage
    budget: int

    def described(self) -> dict[str, Any]:
        """What is in it, as `BagFile.described` has it."""
        if self.kind == "mcap":
            file = self.storage.open(self.uri)
            with contextlib.suppress(BagError):
                read_tail(file.read, file.size)
                return BagFile(self.uri, self.storage, self.budget).described()
        with self._here() as path:
            found = self._made("describe_recording", path, self.budget)
        start, end = found["times"] or (None, None)
        whole = self.kind != "mcap"
        return {
            "bag": self.uri,
            "bytes": found["bytes"],
            "index": "whole" if whole else "missing",
            "advice": None if whole else _ADVICE,
            "start": start,
            "end": end,
            "seconds": None if start is None else round((end - start) / 1e9, 9),
            "messages": found["messages"],
            "chunks": found["chunks"],
            "compressions": found["compressions"],
            "topics": [
                {"topic": topic, "type": kind, "messages": messages}
                for topic, kind, _, messages in found["topics"]
            ],
            "damage": damage_data(found["damage"]),
        }

    def times(self) -> tuple[int, int]:
        """Those of its first and last message in ns; 0 without one."""
        tail = self._tail()
        if tail is not None:
            return times_of(tail)
        described = self.described()
        return described["start"] or 0, described["end"] or 0

    def part(self, start: int, end: int | None, topics: tuple[str, ...], packing: str) -> Written:
        """Messages with start <= t < end, in ns after its first one, and what is latched then."""
        described = self.described()
        first, last = described["start"] or 0, described["end"] or 0
        if start > last - first:
            raise BagRefusedError(f"{self.uri}: --start lies behind its last message")
        have = [row["topic"] for row in described["topics"]]
        named = [topic for topic in have if not topics or _same(topic, topics)]
        for topic in topics:
            if not any(_same(each, (topic,)) for each in have):
                known = ", ".join(sorted(have)[:10]) or "none"
                raise BagRefusedError(f"{self.uri} has no topic {topic}; it has {known}")
        until = last + 1 if end is None else min(first + end, last + 1)
        window = Window(first + start, first + start, until)
        with self._part_here(window) as path:
            return self._written(
                "slice_recording", path, first + start, until, named, compression=packing
            )

    def checked(self) -> Any:
        """What a look at every record has found."""
        with self._here() as path:
            return self._made("check_recording", path, self.budget)

    def mended(self, packing: str) -> Written:
        """What is whole, with an index."""
        with self._here() as path:
            return self._written("mend_recording", path, compression=packing)

    def converted(self, target: str, packing: str) -> Written:
        """The same messages as a file of the target's name."""
        with self._here() as path:
            return self._written("convert_recording", path, target, compression=packing)

    @contextlib.contextmanager
    def _here(self) -> Iterator[Path]:
        """It as a file or folder of this machine."""
        if self.uri.startswith("file://"):
            yield Path(self.uri.removeprefix("file://"))
            return
        with tempfile.TemporaryDirectory(prefix="bagpipe-") as folder:
            uris = [self.uri]
            if self.kind == "folder":
                uris += self._files()
            left = self.budget
            base = self.uri.rpartition("/")[0] + "/"
            for uri in uris:
                target = Path(folder, uri.removeprefix(base))
                target.parent.mkdir(parents=True, exist_ok=True)
                left -= self._copy(uri, target, left)
            yield Path(folder, self.uri.removeprefix(base))

    def _files(self) -> list[str]:
        try:
            return read_metadata(self.uri, self.storage).files
        except BagError as error:
            raise BagRefusedError(f"{self.uri}: {error}") from error

    def _copy(self, uri: str, target: Path, most: int) -> int:
        file = self.storage.open(uri)
        if file.size > most:
            raise BagRefusedError(
                f"{uri}: {file.size:,} bytes are more than --memory-budget leaves: raise it"
            )
        with target.open("wb") as copy:
            for piece in file.pieces([(0, file.size)], _PIECE_BYTES):
                copy.write(piece)
        return file.size

    @contextlib.contextmanager
    def _part_here(self, window: Window) -> Iterator[Path]:
        """Of MCAP with an index, the chunks that the window needs."""
        tail = self._tail()
        if tail is None:
            with self._here() as path:
                yield path
            return
        ranges = tail.declarations + cut_one(tail, [], window).ranges
        size = sum(length for _, length in ranges)
        if size > self.budget:
            raise BagRefusedError(
                f"{self.uri}: {size:,} bytes are more than --memory-budget allows: raise it, or cut"
                " a shorter part"
            )
        with tempfile.TemporaryDirectory(prefix="bagpipe-") as folder:
            path = Path(folder, "part.mcap")
            with path.open("wb") as part:
                pieces = self.storage.pieces(self.uri, ranges, _PIECE_BYTES)
                part.writelines(framed(ranges, pieces))
            yield path

    def _tail(self) -> BagTail | None:
        if self.kind != "mcap":
            return None
        file = self.storage.open(self.uri)
        try:
            return read_tail(file.read, file.size)
        except BagError:
            return None

    def _made(self, name: str, path: Path, *given: Any, **options: Any) -> Any:
        return asked(name, self.uri, path, *given, **options)

    def _written(self, name: str, path: Path, *given: Any, **options: Any) -> Written:
        data, messages, damage = self._made(name, path, *given, memory=self.budget, **options)
        return Written(data, messages, damage_data(damage))


def recording_at(uri: str, storage: Storage, budget: int) -> BagFile | Elsewhere:
    """Whatever recording lies there. Raises StorageError."""
    kind, uri = kind_of(uri, storage)
    return BagFile(uri, storage, budget) if kind == "bag" else Elsewhere(uri, kind, storage, budget)


def merged(all_of_them: list[Elsewhere], packing: str) -> Written:
    """Several that are no bags as MCAP. Raises StorageError and BagRefusedError."""
    with contextlib.ExitStack() as held:
        paths = [held.enter_context(each._here()) for each in all_of_them]  # noqa: SLF001  its own
        budget = all_of_them[0].budget
        make = _found("merge_recordings")
        try:
            data, messages, _ = make(paths, compression=packing, memory=budget)
        except (ValueError, OSError) as error:
            text = str(error)
            for each, path in zip(all_of_them, paths, strict=True):
                text = text.replace(str(path), each.uri)
            raise BagRefusedError(text) from error
    return Written(data, messages)


def asked(name: str, uri: str, path: Path, *given: Any, **options: Any) -> Any:
    """What the native module makes of a file; its errors name the URI. Raises BagRefusedError."""
    make = _found(name)
    try:
        return make(path, *given, **options)
    except (ValueError, OSError) as error:
        raise BagRefusedError(f"{uri}: {str(error).removeprefix(f'{path}: ')}") from error


def _found(name: str) -> Callable[..., Any]:
    try:
        found: Callable[..., Any] = native(name, "reading a recording")
    except NativeModuleError as error:
        raise BagRefusedError(str(error)) from error
    return found


def _same(topic: str, names: tuple[str, ...]) -> bool:
    """By their names in the ROS graph, which begin with a slash."""
    return topic.removeprefix("/") in {name.removeprefix("/") for name in names}
