"""Results on storage that this machine reaches by itself."""

import math
import posixpath
import time
from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager

from bagpipe.cli.pulling.entry import MOST_ENTRIES, Entry, PullError, is_fit, unfit
from bagpipe.storage import Storage, StorageError

_PIECE_BYTES = 1 << 20
_AT_ONCE = 8
_MOST_FOLDERS = 8


@contextmanager
def pull_errors() -> Iterator[None]:
    """Storage's sentences as this verb's."""
    try:
        yield
    except StorageError as error:
        raise PullError(str(error)) from error


class StoredFolder:
    """A results folder by its URI, until a moment of time.monotonic(). Every method raises
    PullError.
    """

    def __init__(self, uri: str, storage: Storage, until: float = math.inf) -> None:
        self._uri, self._storage, self._until = uri.rstrip("/"), storage, until

    def listed(self) -> tuple[list[Entry], list[str]]:
        """The files that can be copied, and the names of those that can't."""
        found: list[Entry] = []
        refused: list[str] = []
        level = [""]
        with pull_errors(), ThreadPoolExecutor(_AT_ONCE) as pool:
            for _ in range(_MOST_FOLDERS):
                self._check_time()
                names = [
                    posixpath.join(folder, name) for folder in level for name in self._in(folder)
                ]
                refused += unfit(names)
                fit = [name for name in names if is_fit(name)]
                if len(found) + len(fit) > MOST_ENTRIES:
                    raise PullError(f"{self._uri} has more than {MOST_ENTRIES:,} files")
                looked = list(pool.map(self._entry, fit))
                found += [entry for entry in looked if entry is not None]
                level = [name for name, entry in zip(fit, looked, strict=True) if entry is None]
        if not found:
            raise PullError(f"{self._uri} has no files, or is not there")
        return found, refused

    def sent(self, wanted: Sequence[Entry]) -> Iterator[tuple[Entry, Iterator[bytes]]]:
        """Each wanted file with its pieces; one that has changed since it was listed is refused."""
        for entry in wanted:
            yield entry, self._pieces(entry)

    def _pieces(self, entry: Entry) -> Iterator[bytes]:
        with pull_errors():
            uri = f"{self._uri}/{entry.name}"
            whole = [(0, entry.size)]
            for piece in self._storage.pieces(uri, whole, _PIECE_BYTES, entry.version):
                self._check_time()
                yield piece

    def _check_time(self) -> None:
        if time.monotonic() > self._until:
            raise PullError(
                "the time that --timeout allows is over; pull again, and it goes on where it"
                " stopped"
            )

    def _in(self, folder: str) -> list[str]:
        return self._storage.names(posixpath.join(self._uri, folder))

    def _entry(self, name: str) -> Entry | None:
        """None for a folder."""
        uri = f"{self._uri}/{name}"
        if not self._storage.exists(uri):
            return None
        stat = self._storage.stat(uri)
        return Entry(name, stat.size, stat.version)
