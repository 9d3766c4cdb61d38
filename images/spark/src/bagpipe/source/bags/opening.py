"""Recordings as planning sees them: a bag, a file of MCAP, or a folder of rosbag2."""

from functools import partial
from typing import Protocol

from bagpipe.plan.bag_tail import BagTail, Chunk, message_times, read_tail
from bagpipe.plan.case import Case
from bagpipe.plan.fragments import FragmentPlan
from bagpipe.plan.rosbag2 import Rosbag2
from bagpipe.plan.rosbag2_metadata import is_folder, read_metadata
from bagpipe.storage import OpenFile, Storage


class Recording(Protocol):
    """What planning needs of one."""

    @property
    def tail(self) -> BagTail:
        """Its connections and chunks."""

    def times(self, chunk: Chunk, /) -> dict[int, list[int]]:
        """Times in ns of a chunk's messages for each connection. Raises BagError, StorageError."""

    def case(self, name: str, fragment: FragmentPlan, topics: list[str], /) -> Case:
        """A fragment of it as a case of that name."""


class OneFile:
    """A bag or a file of MCAP."""

    def __init__(self, file: OpenFile) -> None:
        self._file = file
        self.tail = read_tail(file.read, file.size)
        self.times = partial(message_times, file.read)

    def case(self, name: str, fragment: FragmentPlan, _topics: list[str]) -> Case:
        """The ranges of the file."""
        return Case(
            id=name,
            bag=self._file.uri,
            bag_version=self._file.version,
            window=fragment.window,
            connections=self.tail.declarations,
            ranges=fragment.ranges,
            messages=fragment.messages,
            stated=fragment.stated,
        )


class Folder:
    """A folder of rosbag2."""

    def __init__(self, folder: Rosbag2) -> None:
        self._folder = folder
        self.tail = folder.tail
        self.times = folder.times

    def case(self, name: str, fragment: FragmentPlan, topics: list[str]) -> Case:
        """The ranges of each file, as parts."""
        return Case(
            id=name,
            bag=self._folder.metadata.uri,
            bag_version=self._folder.version,
            window=fragment.window,
            connections=[],
            ranges=[],
            messages=fragment.messages,
            parts=self._folder.parts(fragment, topics),
        )


def opened(uri: str, storage: Storage) -> Recording:
    """A recording, of which indexes alone are read where it has them.

    Raises BagError and StorageError.
    """
    if is_folder(uri):
        return Folder(Rosbag2(read_metadata(uri, storage), storage))
    return OneFile(storage.open(uri))
