"""The door to storage: every method takes URIs as the user wrote them."""

import contextlib
import uuid
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import TypeVar

from bagpipe.storage.backend import ChangedError, Sink, Stat
from bagpipe.storage.faults import StorageError, StorageUnfitError, refusal, storage_errors
from bagpipe.storage.folders import once, real_paths
from bagpipe.storage.globs import is_pattern
from bagpipe.storage.kinds import locate, restore
from bagpipe.storage.reading import OpenFile, fetch
from bagpipe.storage.retries import Clock, Patience, persistently

T = TypeVar("T")

_VOLUMES = frozenset({"pvc", "file"})
_ELSEWHERE = (
    "Write spec.output.uri on another storage, or a server's version that keeps the condition"
)


@dataclass(frozen=True)
class Storage:
    """Access to URIs, given where each volume claim is mounted (claim name to path).

    Credentials come from the environment of the process alone. Every method raises
    StorageError, whose sentence names the URI; none waits longer than `patience` allows.
    """

    volumes: dict[str, str]
    patience: Patience = field(default_factory=Patience)
    clock: Clock = field(default_factory=Clock)

    def expand(self, pattern: str) -> list[str]:
        """The URIs that a pattern names, sorted; empty where there is none."""
        # What a pattern has found may have brackets in its name, and is found by that again.
        plain = not is_pattern(pattern)
        if (plain or "[" in pattern) and self.exists(pattern):
            return [pattern]
        if plain:
            return []
        backend, path = locate(pattern, self.volumes, self.patience)
        with storage_errors(pattern, "read"):
            found = self._asked(lambda: backend.glob(path))
        return sorted(restore(pattern, name, self.volumes) for name in found)

    def each_once(self, uris: list[str]) -> list[str]:
        """Of files of volumes that links, or claims of one folder, give several names, one of
        these; all others as they are.

        Raises StorageError.
        """
        paths, named = self._paths(uris), dict[str, str]()
        for uri, path in paths.items():
            named.setdefault(path, uri)
        kept = {named[path] for path in once(list(named))}
        return [uri for uri in uris if uri in kept or uri not in paths]

    def own_names(self, uris: list[str]) -> dict[str, str]:
        """For each URI the one that its file has without links; for all others itself.

        Raises StorageError.
        """
        paths = self._paths(uris)
        real = real_paths(paths.values())
        return {uri: f"file://{real[paths[uri]]}" if uri in paths else uri for uri in uris}

    def _paths(self, uris: list[str]) -> dict[str, str]:
        """Those of files of volumes."""
        return {
            uri: locate(uri, self.volumes, self.patience)[1]
            for uri in uris
            if uri.partition("://")[0] in _VOLUMES
        }

    def exists(self, uri: str) -> bool:
        """Whether there is a file (not a folder) of that name."""
        backend, path = locate(uri, self.volumes, self.patience)
        with storage_errors(uri, "read"):
            try:
                self._asked(lambda: backend.stat(path))
            except FileNotFoundError:
                return False
            return True

    def open(self, uri: str, version: str = "") -> OpenFile:
        """A file for reading, with its size and version, by one request.

        With a `version` from an earlier look: also refuses a file that changed since.
        """
        backend, path = locate(uri, self.volumes, self.patience)
        with storage_errors(uri, "read"):
            stat = self._asked(lambda: backend.stat(path))
        if version and stat.version != version:
            raise refusal(ChangedError(), uri, "read")
        return OpenFile(uri, stat, backend, path, self.patience, self.clock)

    def stat(self, uri: str) -> Stat:
        """Bytes of a file, and a mark that changes with its content."""
        return self.open(uri).stat

    def size(self, uri: str) -> int:
        """Bytes of a file."""
        return self.open(uri).size

    def read(self, uri: str, offset: int, length: int) -> bytes:
        """`length` bytes from `offset`, fewer only at the end of the file."""
        return self.open(uri).read(offset, length)

    def read_all(self, uri: str, limit_bytes: int) -> bytes:
        """A whole file; a longer one than `limit_bytes` is an error."""
        file = self.open(uri)
        if file.size > limit_bytes:
            raise StorageError(
                f"{uri} has {file.size} bytes where at most {limit_bytes} are expected"
            )
        return file.read(0, file.size)

    def pieces(
        self, uri: str, ranges: list[tuple[int, int]], piece_bytes: int, version: str = ""
    ) -> Iterator[bytes]:
        """The (offset, length) ranges of a file, in order, in pieces of at most `piece_bytes`.

        Raises StorageError also where the file ends before a range does, or is no longer the
        one that had `version` (empty: the one that is there when reading begins).
        """
        yield from self.open(uri, version).pieces(ranges, piece_bytes)

    def read_planned(self, uri: str, length: int, version: str) -> bytes:
        """The first `length` bytes, 4 MiB at most, of the file that had `version`: one request.

        Raises StorageError also where it is no longer that file.
        """
        backend, path = locate(uri, self.volumes, self.patience)
        try:
            return fetch(backend, path, (0, length), version, (self.patience, self.clock))
        except OSError as error:
            raise refusal(error, uri, "read") from error

    @contextmanager
    def create(self, uri: str) -> Iterator["NewFile"]:
        """A new file that appears under its name only when the block ends well.

        What the block raises passes unchanged.
        """
        backend, path = locate(uri, self.volumes, self.patience)
        with storage_errors(uri, "written"):
            sink = self._asked(lambda: backend.create(path))
        try:
            yield NewFile(uri, sink)
            with storage_errors(uri, "written"):
                sink.commit()
        finally:
            with storage_errors(uri, "written"):
                sink.abandon()

    def put_once(self, uri: str, data: bytes) -> bool:
        """Create a file with all of `data`, unless a file has that name: then False.

        Of several callers at the same time, in whatever pods, exactly one gets True. Nobody
        ever sees the file half written.
        """
        backend, path = locate(uri, self.volumes, self.patience)
        writer = uuid.uuid4().hex
        with storage_errors(uri, "written"):
            return self._asked(lambda: backend.put_once(path, data, writer))

    def check_put_once(self, folder: str) -> None:
        """Try in a folder, which is made, whether `put_once` has one winner there.

        Some servers that speak S3 take a second object of one name whatever the condition of the
        request; of two drivers both would count then. Raises StorageUnfitError, and StorageError.
        """
        uri = f"{folder.rstrip('/')}/probe-{uuid.uuid4().hex}"
        first, second = (uuid.uuid4().bytes for _ in range(2))
        try:
            if not self.put_once(uri, first):
                raise StorageUnfitError(
                    f"{folder} can't hold results: its storage says that a name is taken which"
                    f" nobody has taken. {_ELSEWHERE}"
                )
            if self.put_once(uri, second) or self.read_all(uri, 1 << 20) != first:
                raise StorageUnfitError(
                    f"{folder} can't hold results: its storage replaced a file that was to be"
                    " created only where there is none (on object stores: a put with"
                    f" If-None-Match: *), so two drivers could both count. {_ELSEWHERE}"
                )
        finally:
            with contextlib.suppress(StorageError):
                self.remove(uri)

    def names(self, folder: str) -> list[str]:
        """The names in a folder, sorted; empty where it does not exist.

        On volumes and HDFS, writers that died may have left names that end in `.part`.
        """
        backend, path = locate(folder, self.volumes, self.patience)
        with storage_errors(folder, "read"):
            return sorted(self._asked(lambda: backend.names(path)))

    def remove(self, uri: str) -> None:
        """Remove a file that may be gone already."""
        backend, path = locate(uri, self.volumes, self.patience)
        with storage_errors(uri, "removed"):
            self._asked(lambda: backend.remove(path))

    def _asked(self, ask: Callable[[], T]) -> T:
        return persistently(ask, self.patience, self.clock)


@dataclass(frozen=True)
class NewFile:
    """A file that is being written; its faults name the URI."""

    uri: str
    _sink: Sink

    def write(self, data: bytes) -> None:
        """Append. Raises StorageError, for example on a full volume."""
        with storage_errors(self.uri, "written"):
            self._sink.write(data)
