"""What is planned: a bag by its tail, and MCAP or a folder of rosbag2 as parts of files."""

from dataclasses import dataclass
from functools import partial

from bagpipe.plan.bag_tail import BagError, BagTail, message_times, read_tail
from bagpipe.plan.fragments import FragmentPlan
from bagpipe.plan.part import Part
from bagpipe.plan.rosbag2 import Rosbag2
from bagpipe.plan.rosbag2_metadata import is_folder, read_metadata
from bagpipe.storage import OpenFile, Storage, StorageError


@dataclass(frozen=True)
class Bag:
    """A bag, whose fragments are read chunk by chunk."""

    file: OpenFile
    tail: BagTail


class McapFile:
    """A file of MCAP, whose fragments have one part."""

    def __init__(self, file: OpenFile, tail: BagTail) -> None:
        self._file = file
        self.tail = tail
        self.version = file.version
        self.times = partial(message_times, file.read)

    def parts(self, fragment: FragmentPlan, topics: list[str]) -> list[Part]:
        """The ranges of the file."""
        if not fragment.messages:
            return []
        part = Part(
            bag=self._file.uri,
            version=self.version,
            topics=topics,
            window=fragment.window,
            at=fragment.window.start,
            connections=self.tail.declarations,
            ranges=fragment.ranges,
            messages=fragment.messages,
            stated=fragment.stated,
        )
        return [part]


def recording(uri: str, storage: Storage) -> Bag | McapFile | Rosbag2:
    """What is at a URI, by its index. Raises StorageError."""
    try:
        if is_folder(uri):
            return Rosbag2(read_metadata(uri, storage), storage, most_times=0)
        file = storage.open(uri)
        tail = read_tail(file.read, file.size)
    except BagError as error:
        raise StorageError(f"{uri}: {error}") from error
    return McapFile(file, tail) if tail.is_mcap else Bag(file, tail)
