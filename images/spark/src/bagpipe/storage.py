"""Where bags come from and results go: URIs through fsspec, and the one place that knows `pvc://`.

A claim is mounted into driver and executors; `pvc://<claim>/<path>` is the path below its
mount. Nothing outside this module sees a local path.
"""

import posixpath
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import BinaryIO, cast

import fsspec


class StorageError(Exception):
    """Storage refused; the sentence names the URI as the user wrote it."""


@dataclass(frozen=True)
class Storage:
    """Access to URIs, given where each volume claim is mounted (claim name to path)."""

    volumes: dict[str, str]

    def expand(self, pattern: str) -> list[str]:
        """The URIs that a pattern names, sorted; empty where there is none."""
        files, path = self._locate(pattern)
        if "*" not in path and "?" not in path and "[" not in path:
            return [pattern] if files.isfile(path) else []
        found = [str(entry) for entry in files.glob(path) if files.isfile(entry)]
        return sorted(self._restore(pattern, entry) for entry in found)

    def size(self, uri: str) -> int:
        """Bytes of a file. Raises StorageError."""
        files, path = self._locate(uri)
        try:
            return int(files.size(path))
        except OSError as error:
            raise StorageError(f"{uri} can't be read: {error.strerror or error}") from error

    def read(self, uri: str, offset: int, length: int) -> bytes:
        """`length` bytes from `offset`, fewer only at the end of the file. Raises StorageError."""
        with self._reader(uri) as file:
            return read_fully(file, offset, length)

    def pieces(self, uri: str, ranges: list[tuple[int, int]], piece_bytes: int) -> Iterator[bytes]:
        """The (offset, length) ranges of a file, in order, in pieces of at most `piece_bytes`.

        Raises StorageError, also where the file ends before a range does.
        """
        with self._reader(uri) as file:
            for offset, length in ranges:
                at = offset
                while at < offset + length:
                    piece = read_fully(file, at, min(piece_bytes, offset + length - at))
                    if not piece:
                        raise StorageError(
                            f"{uri} ends at byte {at}, but its index names bytes up to"
                            f" {offset + length}: the file changed while the job ran"
                        )
                    yield piece
                    at += len(piece)

    @contextmanager
    def create(self, uri: str) -> Iterator["NewFile"]:
        """A new file that appears under its name only when the block ends well.

        Raises StorageError for its own faults; what the block raises passes unchanged.
        """
        files, path = self._locate(uri)
        part = f"{path}.part"
        try:
            with _told_as_unwritable(uri):
                files.makedirs(posixpath.dirname(path), exist_ok=True)
                file = files.open(part, "wb")
            try:
                yield NewFile(uri, file)
            finally:
                with _told_as_unwritable(uri):
                    file.close()
            with _told_as_unwritable(uri):
                files.mv(part, path)
        finally:
            if files.exists(part):
                files.rm_file(part)

    def names(self, folder: str) -> list[str]:
        """The file names in a folder; empty where it does not exist."""
        files, path = self._locate(folder)
        if not files.isdir(path):
            return []
        return sorted(posixpath.basename(str(entry)) for entry in files.ls(path, detail=False))

    def remove(self, uri: str) -> None:
        """Remove a file that may be gone already."""
        files, path = self._locate(uri)
        if files.exists(path):
            files.rm_file(path)

    @contextmanager
    def _reader(self, uri: str) -> Iterator[BinaryIO]:
        files, path = self._locate(uri)
        try:
            # Ranges are read once and in order: a cache would only copy.
            with files.open(path, "rb", cache_type="none") as file:
                yield cast("BinaryIO", file)
        except OSError as error:
            raise StorageError(f"{uri} can't be read: {error.strerror or error}") from error

    def _locate(self, uri: str) -> tuple[fsspec.AbstractFileSystem, str]:
        if uri.startswith("pvc://"):
            claim, _, path = uri.removeprefix("pvc://").partition("/")
            if claim not in self.volumes:
                raise StorageError(f"{uri}: the claim {claim} is not mounted in this pod")
            uri = f"file://{self.volumes[claim]}/{path}"
        files, path = fsspec.core.url_to_fs(uri)
        return files, str(path)

    def _restore(self, pattern: str, path: str) -> str:
        scheme, _, rest = pattern.partition("://")
        if scheme != "pvc":
            return f"{scheme}://{path}"
        claim = rest.split("/", 1)[0]
        return f"pvc://{claim}/{posixpath.relpath(path, self.volumes[claim])}"


@dataclass(frozen=True)
class NewFile:
    """A file that is being written; its faults name the URI."""

    uri: str
    _file: BinaryIO

    def write(self, data: bytes) -> None:
        """Append. Raises StorageError, for example on a full volume."""
        with _told_as_unwritable(self.uri):
            self._file.write(data)


@contextmanager
def _told_as_unwritable(uri: str) -> Iterator[None]:
    try:
        yield
    except OSError as error:
        raise StorageError(f"{uri} can't be written: {error.strerror or error}") from error


def read_fully(file: BinaryIO, offset: int, length: int) -> bytes:
    """`length` bytes from `offset`; fewer only where the file ends."""
    file.seek(offset)
    data = file.read(length)
    while len(data) < length:
        more = file.read(length - len(data))
        if not more:
            break
        data += more
    return data
