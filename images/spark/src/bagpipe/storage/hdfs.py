"""`hdfs://<namenode>:<port>/<path>`, by hdfs-native, which speaks Hadoop's own protocol.

The user is HADOOP_USER_NAME; a cluster with Kerberos or several NameNodes is described by the
Hadoop configuration in HADOOP_CONF_DIR.
"""

import contextlib
import os
import uuid
from collections.abc import Callable
from typing import TypeVar

import hdfs_native

from bagpipe.storage.backend import ChangedError, Stat
from bagpipe.storage.globs import fixed_folder, is_of_one_folder, matcher
from bagpipe.storage.hdfs_faults import within
from bagpipe.storage.retries import Clock, Patience, persistently

T = TypeVar("T")


class HdfsBackend:
    """One NameNode, or the name of a group of them."""

    parallel = 8
    gap_bytes = 256 << 10

    def __init__(self, authority: str, patience: Patience) -> None:
        self._patience = patience
        self._seconds = patience.request_seconds
        # Our own retries are above these; the library's own last for minutes.
        limits = {
            "dfs.client.socket-timeout": str(int(patience.request_seconds * 1000)),
            "dfs.client.failover.max.attempts": "2",
            "dfs.client.failover.sleep.base.millis": "100",
            "dfs.client.failover.sleep.max.millis": "500",
        }
        url = f"hdfs://{authority}"
        if ":" not in authority and "HADOOP_CONF_DIR" not in os.environ:
            url += ":8020"  # Hadoop's own default; its configuration may know a group's name
        self._client = self._ask(lambda: hdfs_native.Client(url, limits))
        # Writers whose rename was sent and whose answer was lost.
        self._unconfirmed: set[str] = set()

    def stat(self, path: str) -> Stat:
        """Size and version of a file; FileNotFoundError where there is none."""
        found = self._ask(lambda: self._client.get_file_info(f"/{path}"))
        if found.isdir:
            raise FileNotFoundError("it is a folder, not a file")
        return _stat(found)

    def read(self, path: str, offset: int, length: int, version: str) -> bytes:
        """Bytes from `offset`; HDFS answers all of them or not at all."""

        def read() -> bytes:
            if _stat(self._client.get_file_info(f"/{path}")).version != version:
                raise ChangedError
            return self._client.read(f"/{path}").read_range(offset, length)

        return self._ask(read)

    def glob(self, pattern: str) -> list[str]:
        """The files that a pattern matches, below the folder before its first wildcard."""
        folder = fixed_folder(pattern)
        matches = matcher(pattern)
        deep = not is_of_one_folder(pattern)
        found = (entry.path.lstrip("/") for entry in self._listed(folder, deep) if not entry.isdir)
        return [path for path in found if matches(path)]

    def names(self, folder: str) -> list[str]:
        """The names in a folder; empty where it does not exist."""
        return [entry.path.rpartition("/")[2] for entry in self._listed(folder, deep=False)]

    def remove(self, path: str) -> None:
        """Remove a file that may be gone already."""
        self._ask(lambda: self._client.delete(f"/{path}", False))

    def create(self, path: str) -> "HdfsSink":
        """Begin a file beside its later name, making its folders."""
        return HdfsSink(self._client, self._patience, f"/{path}", uuid.uuid4().hex)

    def put_once(self, path: str, data: bytes, writer: str) -> bool:
        """Create a whole file by a rename, which HDFS refuses where the name is taken."""
        part = _part(f"/{path}", writer)
        if writer in self._unconfirmed and not _is_there(self._client, self._seconds, part):
            self._unconfirmed.discard(writer)
            return True
        if writer not in self._unconfirmed:
            sink = HdfsSink(self._client, self._patience, f"/{path}", writer)
            sink.write(data)
            sink.close()
        self._unconfirmed.add(writer)
        won = self._renamed(part, f"/{path}")
        self._unconfirmed.discard(writer)
        if not won:
            self.remove(part.lstrip("/"))
        return won

    def _renamed(self, part: str, path: str) -> bool:
        """Rename once; False where the name is another file's.

        The library asks another NameNode by itself, which then finds its own rename done: the
        name taken, or the part gone. Only our rename takes the part away.
        """
        try:
            self._ask(lambda: self._client.rename(part, path, False))
        except (FileExistsError, FileNotFoundError) as error:
            if not _is_there(self._client, self._seconds, part):
                if _is_there(self._client, self._seconds, path):
                    return True
                raise
            if isinstance(error, FileNotFoundError):
                raise
            return False
        return True

    def _listed(self, folder: str, deep: bool) -> list[hdfs_native.FileStatus]:
        try:
            return self._ask(lambda: list(self._client.list_status(f"/{folder}", deep)))
        except FileNotFoundError:
            return []

    def _ask(self, ask: Callable[[], T]) -> T:
        return within(self._seconds, ask)


class HdfsSink:
    """A file that is written under a name of its own and renamed when it is whole."""

    def __init__(
        self, client: hdfs_native.Client, patience: Patience, path: str, writer: str
    ) -> None:
        self._client = client
        self._patience = patience
        self._seconds = patience.request_seconds
        self._path = path
        self._part: str | None = _part(path, writer)
        # A rename was sent and its answer was lost.
        self._unconfirmed = False
        options = hdfs_native.WriteOptions(overwrite=True, create_parent=True)
        self._file: hdfs_native.FileWriter | None = within(
            self._seconds, lambda: client.create(_part(path, writer), options)
        )

    def write(self, data: bytes) -> None:
        """Append; HDFS itself replaces a DataNode that fails. Raises OSError."""
        file = self._file
        if file is not None:
            within(self._seconds, lambda: file.write(data))

    def close(self) -> None:
        """Have HDFS confirm every block, once: the library can't repeat it. Raises OSError."""
        file, self._file = self._file, None
        if file is not None:
            within(self._seconds, file.close)

    def commit(self) -> None:
        """Rename: readers see the file whole or not at all."""
        self.close()
        part = self._part
        if part is not None:
            persistently(lambda: self._rename(part), self._patience, Clock())
            self._part = None

    def _rename(self, part: str) -> None:
        """Once; a try whose answer was lost has succeeded if only the later name is there.

        Nobody else knows the name of the part.
        """
        if self._unconfirmed and not _is_there(self._client, self._seconds, part):
            if _is_there(self._client, self._seconds, self._path):
                return
            raise FileNotFoundError("it vanished while it was renamed")
        self._unconfirmed = True
        within(self._seconds, lambda: self._client.rename(part, self._path, True))

    def abandon(self) -> None:
        """Remove what is left of the file under its temporary name."""
        part, self._part = self._part, None
        if part is None:
            return
        # HDFS also takes away a file that is still open; nobody closes a writer that failed.
        with contextlib.suppress(OSError):
            within(self._seconds, lambda: self._client.delete(part, False))


def _is_there(client: hdfs_native.Client, seconds: float, path: str) -> bool:
    try:
        within(seconds, lambda: client.get_file_info(path))
    except FileNotFoundError:
        return False
    return True


def _part(path: str, writer: str) -> str:
    folder, _, name = path.rpartition("/")
    return f"{folder}/.{name}.{writer[:12]}.part"


def _stat(found: hdfs_native.FileStatus) -> Stat:
    return Stat(found.length, f"{found.length}-{found.modification_time}")
