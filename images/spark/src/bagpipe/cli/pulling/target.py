"""The folder on this machine into which results are copied."""

import contextlib
import fcntl
import json
import os
import re
import shutil
from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import BinaryIO

from bagpipe.cli.places import file_uri
from bagpipe.cli.pulling.entry import MARKER, Entry, PullError
from bagpipe.quantities import size
from bagpipe.storage import Storage, StorageError

# A line for each file, whose name is short.
_MOST_MARKER_BYTES = 256 << 20
_UNFINISHED = re.compile(r"\..+\.[0-9a-f]{24}\.part")
_SPARE_BYTES = 16 << 20


@dataclass(frozen=True)
class Origin:
    """Whose results a folder holds; another job of the same name has another uid."""

    namespace: str
    job: str
    uid: str
    results: str


class Target:
    """A folder that this process alone writes into, and what earlier pulls have left in it.

    Files get their names when they are whole; none is ever replaced.
    """

    def __init__(self, folder: Path, marker: BinaryIO, have: dict[str, Entry]) -> None:
        self.folder = folder
        self._marker = marker
        self._have = have
        self._storage = Storage({})

    def missing(self, wanted: Sequence[Entry]) -> list[Entry]:
        """What is not here yet. Raises PullError where something else has its name or place."""
        return [entry for entry in wanted if not self._is_here(entry)]

    def check_room(self, wanted: Sequence[Entry]) -> None:
        """Raises PullError where the disk has too little."""
        needed = sum(entry.size for entry in wanted)
        free = shutil.disk_usage(self.folder).free
        if wanted and needed + _SPARE_BYTES > free:
            raise PullError(
                f"{self.folder} has room for {size(free)}, and {size(needed)} are to come: name"
                " another folder, or fewer files by --only"
            )

    @contextlib.contextmanager
    def file(self, entry: Entry) -> Iterator[Callable[[bytes], None]]:
        """A file that appears when the block ends well. Raises PullError, and what the block does.

        That it is to come is noted before: one that is here without a note is somebody else's.
        """
        try:
            with self._storage.create(file_uri(self.folder / entry.name)) as new:
                yield new.write
                if self._path(entry).exists():
                    raise PullError(f"{self._path(entry)} is there by now, and is not replaced")
                self._note(entry)
        except StorageError as error:
            raise PullError(str(error)) from error

    def _note(self, entry: Entry) -> None:
        self._marker.write(json.dumps(asdict(entry)).encode() + b"\n")
        self._marker.flush()
        self._have[entry.name] = entry

    def _path(self, entry: Entry) -> Path:
        return self.folder / entry.name

    def _is_here(self, entry: Entry) -> bool:
        path = self._path(entry)
        if not path.parent.resolve().is_relative_to(self.folder.resolve()):
            raise PullError(f"{path.parent} is a link that leads out of {self.folder}: remove it")
        if not os.path.lexists(path):
            return False
        had = self._have.get(entry.name)
        if had is not None and had != entry:
            raise PullError(
                f"{path} was pulled before, and the job's {entry.name} is another one by now: name"
                " another folder"
            )
        if had is None or path.is_symlink() or not path.is_file():
            raise PullError(f"{path} is there, and no pull has made it: move it away")
        if path.stat().st_size != entry.size:
            raise PullError(f"{path} was changed since it was pulled: move it away")
        return True


@contextlib.contextmanager
def target_at(folder: Path, origin: Origin) -> Iterator[Target]:
    """The folder, made where there is none. Raises PullError where it is not ours to write to."""
    marker = folder / MARKER
    try:
        _check(folder, marker)
        folder.mkdir(parents=True, exist_ok=True)
        flags = os.O_RDWR | os.O_CREAT | os.O_APPEND | os.O_NOFOLLOW | os.O_CLOEXEC
        with os.fdopen(os.open(marker, flags, 0o644), "r+b") as file:
            try:
                fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except BlockingIOError as error:
                raise PullError(f"another pull is writing into {folder}: wait for it") from error
            target = Target(folder, file, _read(file, folder, origin))
            _remove_unfinished(folder)
            yield target
    except OSError as error:
        raise PullError(f"{folder} can't be written: {error.strerror or error}") from error


def _check(folder: Path, marker: Path) -> None:
    if os.path.lexists(folder) and not folder.is_dir():
        raise PullError(f"{folder} is there and is no folder: name another one")
    if folder.is_dir() and not marker.is_file() and any(folder.iterdir()):
        raise PullError(
            f"{folder} holds files that no pull has made: name a folder that is not there yet"
        )


def _read(file: BinaryIO, folder: Path, origin: Origin) -> dict[str, Entry]:
    """What the marker says has come; a new one gets its first line. A torn last line counts not."""
    text = file.read(_MOST_MARKER_BYTES + 1)
    if not text:
        file.write(json.dumps(asdict(origin)).encode() + b"\n")
        file.flush()
        return {}
    try:
        first, *lines = text.decode().split("\n")
        found = Origin(**json.loads(first))
        last = lines.pop() if lines else ""
        entries = [Entry(**json.loads(line)) for line in lines if line]
    except (ValueError, TypeError, RecursionError) as error:
        raise PullError(
            f"{folder / MARKER} can't be read ({error}): name another folder"
        ) from error
    if found != origin:
        raise PullError(
            f"{folder} holds results of job {found.namespace}/{found.job} ({found.results}): name"
            " another folder"
        )
    if last:
        file.truncate(len(text) - len(last.encode()))
    return {entry.name: entry for entry in entries}


def _remove_unfinished(folder: Path) -> None:
    for path, _, names in os.walk(folder):
        for name in filter(_UNFINISHED.fullmatch, names):
            Path(path, name).unlink()
