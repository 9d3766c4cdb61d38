"""Files of the pod's own file system: `file://`, and claims where they are mounted."""

import contextlib
import errno
import glob
import os
import stat
import uuid
from pathlib import Path
from typing import BinaryIO

from bagpipe.storage.backend import ChangedError, Stat, UnfitError
from bagpipe.storage.folders import matching

# What a file system answers that knows no hard links.
_NO_LINKS = {errno.EPERM, errno.ENOTSUP, errno.ENOSYS, errno.EMLINK}


# The process's own secrets (its environment, its token), by whatever link they are reached.
_NEVER = tuple(Path(path) for path in ("/proc", "/sys", "/run/secrets", "/var/run/secrets"))


class LocalBackend:
    """Plain system calls; a path is absolute and stays below `root`, also by symbolic links.

    Whoever wrote the volume may have put a link there that leads to the pod's own files.
    """

    parallel = 1
    gap_bytes = 0

    def __init__(self, root: str) -> None:
        self._root = Path(root).resolve()
        self._given = root.rstrip("/")

    def stat(self, path: str) -> Stat:
        """Size and version of a file; FileNotFoundError where there is none."""
        self._inside(Path(path).resolve())
        found = Path(path).stat()
        if not stat.S_ISREG(found.st_mode):
            raise FileNotFoundError(errno.ENOENT, "it is a folder, not a file", path)
        return _stat(found)

    def read(self, path: str, offset: int, length: int, version: str) -> bytes:
        """Bytes from `offset`, fewer only where the file was cut off this moment."""
        descriptor = os.open(path, os.O_RDONLY | os.O_CLOEXEC)
        try:
            # What was opened, not what a link says by now.
            self._inside(Path(f"/proc/self/fd/{descriptor}").readlink())
            if _stat(os.fstat(descriptor)).version != version:
                raise ChangedError
            return os.pread(descriptor, length, offset)
        finally:
            os.close(descriptor)

    def glob(self, pattern: str) -> list[str]:
        """The files that a pattern matches; a name that begins with a dot only where it says so."""
        below = pattern.removeprefix(self._given)
        # A folder that was mounted, or given, may have any name: it is no part of the pattern.
        return matching(f"{glob.escape(self._given)}{below}", self._inside)

    def names(self, folder: str) -> list[str]:
        """The names in a folder; empty where it does not exist."""
        self._inside(Path(folder).resolve())
        try:
            return [entry.name for entry in Path(folder).iterdir()]
        except (FileNotFoundError, NotADirectoryError):
            return []

    def remove(self, path: str) -> None:
        """Remove a file that may be gone already."""
        self._inside(Path(path).parent.resolve())
        Path(path).unlink(missing_ok=True)

    def create(self, path: str) -> "LocalSink":
        """Begin a file, making its folders."""
        self._inside(Path(path).parent.resolve())
        return LocalSink(path)

    def put_once(self, path: str, data: bytes, writer: str) -> bool:
        """Create a whole file by a hard link, which fails where the name is taken.

        Over a network the answer may be another try's: a server that made the link, and was asked
        again because its word was lost, says that the name is taken. The file knows better.
        """
        self._inside(Path(path).parent.resolve())
        sink = LocalSink(path, writer)
        try:
            sink.write(data)
            sink.flush()
            return _linked(sink)
        finally:
            sink.abandon()

    def _inside(self, found: Path) -> None:
        if not found.is_relative_to(self._root) or any(map(found.is_relative_to, _NEVER)):
            raise PermissionError(
                errno.EPERM,
                "a symbolic link leads out of the volume: put the file itself there",
                str(found),
            )


class LocalSink:
    """A file beside its later name, under one that no other writer has."""

    def __init__(self, path: str, writer: str = "") -> None:
        self.path = Path(path)
        self.path.parent.mkdir(parents=True, exist_ok=True)
        own = f"{writer[:12]}{uuid.uuid4().hex[:12]}"
        self.part = self.path.with_name(f".{self.path.name}.{own}.part")
        self._file: BinaryIO = self.part.open("xb")

    def write(self, data: bytes) -> None:
        """Append. Raises OSError, for example on a full volume."""
        self._file.write(data)

    def flush(self) -> None:
        """Have the volume hold all that was written, also when its node dies."""
        self._file.flush()
        os.fsync(self._file.fileno())

    def commit(self) -> None:
        """Rename: readers see the file whole or not at all, also after its node lost power."""
        # A manifest that is put later is durable: the files that it names must not be empty then.
        self.flush()
        self._file.close()
        self.part.replace(self.path)

    def abandon(self) -> None:
        """Remove what is left of the file under its temporary name."""
        # Closing writes what is buffered, which a full volume refuses once more.
        with contextlib.suppress(OSError):
            self._file.close()
        self.part.unlink(missing_ok=True)


def _linked(sink: LocalSink) -> bool:
    """Give the file its later name as well; False where that is another file's."""
    try:
        sink.path.hardlink_to(sink.part)
    except OSError as error:
        if _is_linked(sink):
            return True
        if isinstance(error, FileExistsError):
            return False
        if error.errno in _NO_LINKS:
            raise UnfitError(
                error.errno,
                "the volume's file system has no hard links, which make a file appear whole and"
                " only once: keep results on another volume",
            ) from error
        raise
    return True


def _is_linked(sink: LocalSink) -> bool:
    """Whether the file has its later name after all: as the server says, not a client's memory.

    Nobody else knows the file's first name, so a second link of it is the one that was asked for.
    """
    try:
        # Opening is what makes an NFS client ask.
        with sink.part.open("rb") as own:
            found = os.fstat(own.fileno())
        if found.st_nlink > 1:
            return True
        with sink.path.open("rb") as named:
            return os.path.samestat(found, os.fstat(named.fileno()))
    except OSError:
        return False


def _stat(found: os.stat_result) -> Stat:
    return Stat(found.st_size, f"{found.st_size}-{found.st_mtime_ns}")
