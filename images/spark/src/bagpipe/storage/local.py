"""Files of the pod's own file system: `file://`, and claims where they are mounted."""

import contextlib
import errno
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
_NEVER = ("/proc/", "/sys/", "/run/secrets/", "/var/run/secrets/")
# A pipe that lies where a file was planned must not be waited for.
_READ_ONLY = os.O_RDONLY | os.O_CLOEXEC | os.O_NONBLOCK


class LocalBackend:
    """Plain system calls; a path is absolute and stays below `root`, also by symbolic links.

    Whoever wrote the volume may have put a link there that leads to the pod's own files.
    """

    parallel = 1
    gap_bytes = 0

    def __init__(self, root: str) -> None:
        self._given = root.rstrip("/")

    def stat(self, path: str) -> Stat:
        """Size and version of a file; FileNotFoundError where there is none."""
        self._inside(os.path.realpath(path))
        return _stat(os.stat(path), path)  # noqa: PTH116  a thousand a second

    def read(self, path: str, offset: int, length: int, version: str) -> bytes:
        """Bytes from `offset`, fewer only where the file was cut off this moment."""
        descriptor = os.open(path, _READ_ONLY)
        try:
            # What was opened, not what a link says by now.
            self._inside(os.readlink(f"/proc/self/fd/{descriptor}"))  # noqa: PTH115  as above
            if _version(os.fstat(descriptor), path) != version:
                raise ChangedError
            return os.pread(descriptor, length, offset)
        finally:
            os.close(descriptor)

    def glob(self, pattern: str) -> list[str]:
        """The files that a pattern matches; a name that begins with a dot only where it says so."""
        # A folder that was mounted, or given, may have any name: it is no part of the pattern.
        below = pattern.removeprefix(self._given)
        return matching(self._given, below, lambda found: self._inside(str(found)))

    def names(self, folder: str) -> list[str]:
        """The names in a folder; empty where it does not exist."""
        self._inside(os.path.realpath(folder))
        try:
            return [entry.name for entry in Path(folder).iterdir()]
        except (FileNotFoundError, NotADirectoryError):
            return []

    def remove(self, path: str) -> None:
        """Remove a file that may be gone already."""
        self._inside(os.path.realpath(Path(path).parent))
        Path(path).unlink(missing_ok=True)

    def create(self, path: str) -> "LocalSink":
        """Begin a file, making its folders."""
        self._inside(os.path.realpath(Path(path).parent))
        return LocalSink(path)

    def put_once(self, path: str, data: bytes, writer: str) -> bool:
        """Create a whole file by a hard link, which fails where the name is taken.

        Over a network the answer may be another try's: a server that made the link, and was asked
        again because its word was lost, says that the name is taken. The file knows better.
        """
        self._inside(os.path.realpath(Path(path).parent))
        sink = LocalSink(path, writer)
        try:
            sink.write(data)
            sink.flush()
            return _linked(sink)
        finally:
            sink.abandon()

    def _inside(self, found: str) -> None:
        """Refuse a path without links that is not below `root`, or is the process's own."""
        folder = f"{found}/"
        if not self._is_below_root(folder) or folder.startswith(_NEVER):
            raise PermissionError(
                errno.EPERM,
                "a symbolic link leads out of the volume: put the file itself there",
                found,
            )

    def _is_below_root(self, folder: str) -> bool:
        # A path without links that begins with the root as it was given: that has none either, so
        # that it need not be looked at for each file.
        if folder.startswith(f"{self._given}/"):
            return True
        root = os.path.realpath(self._given or "/")
        return folder.startswith(f"{root.rstrip('/')}/")


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


def _stat(found: os.stat_result, path: str) -> Stat:
    return Stat(found.st_size, _version(found, path))


def _version(found: os.stat_result, path: str) -> str:
    if not stat.S_ISREG(found.st_mode):
        what = "a folder, not a file" if stat.S_ISDIR(found.st_mode) else "no regular file"
        raise FileNotFoundError(errno.ENOENT, f"it is {what}", path)
    return f"{found.st_size}-{found.st_mtime_ns}"
