"""A fragment of a folder of rosbag2, as one stream of MCAP.

A fragment of one file of MCAP travels as its own chunks. One of several files can't, since each of
them counts its channels by itself: the worker makes one file of MCAP of the parts.
"""

from collections.abc import Mapping

from bagpipe.native import native
from bagpipe.plan.bag_tail import BagError
from bagpipe.plan.case import Case
from bagpipe.plan.fragments import cut_one
from bagpipe.plan.in_force import Late
from bagpipe.plan.left_out import check_left_out
from bagpipe.plan.part import Part
from bagpipe.plan.rosbag2 import Rosbag2, joined
from bagpipe.plan.rosbag2_metadata import Metadata, read_metadata
from bagpipe.source.bags.stream import part_file
from bagpipe.storage import Storage, StorageError
from bagpipe.topic_names import resolve
from bagpipe.wire.frames import payloads
from bagpipe.wire.session import InputFile, SessionError


def folder_file(case: Case, storage: Storage, late: Mapping[str, Late]) -> InputFile:
    """The case's input; `late` says of recorded topics what late subscribers get.

    Raises SessionError and StorageError.
    """
    metadata = _metadata(case, storage)
    if len(case.parts) == 1 and metadata.as_stored:
        return part_file(case.parts[0], storage)
    made = _joined(case.parts, metadata, storage, late)
    return InputFile(case.bag, len(made), [], lambda: payloads(made))


def folder_truth(case: Case, topics: set[str], storage: Storage) -> bytes:
    """These topics in the case's window as MCAP, played or not.

    Raises SessionError, BagError and StorageError, which is also that the folder has changed since
    the case was planned.
    """
    metadata = _metadata(case, storage)
    folder = Rosbag2(metadata, storage, most_times=0)
    if folder.version != case.bag_version:
        raise StorageError(
            f"{case.bag}: one of its files is no longer the file that was planned: run the job"
            " again once nobody writes there"
        )
    named = sorted(topics)
    check_left_out(folder.tail, named, folder.times, case.window)
    parts = folder.parts(cut_one(folder.tail, named, case.window), named)
    if not parts:
        raise SessionError("BagUnreadable", f"{case.bag}: no message of {', '.join(named)}")
    return _joined(parts, metadata, storage, {})


def times_of_folder(case: Case, topics: list[str], storage: Storage) -> list[int]:
    """When the case's inputs were recorded. Raises SessionError and StorageError."""
    made = _joined(case.parts, _metadata(case, storage), storage, {})
    recording = native("MemoryMcap", "reading a folder of rosbag2")(made)
    named = [topic for topic in recording.topics if not topics or resolve(topic) in topics]
    window = case.window
    return [time for _, time, _ in recording.messages(named, window.start, window.end)]


def _metadata(case: Case, storage: Storage) -> Metadata:
    try:
        return read_metadata(case.bag, storage, case.bag_version)
    except BagError as error:
        raise SessionError("BagUnreadable", f"{case.bag}: {error}") from error


def _joined(
    parts: list[Part], metadata: Metadata, storage: Storage, late: Mapping[str, Late]
) -> bytes:
    try:
        return joined(parts, metadata, storage, late)
    except BagError as error:
        raise SessionError(error.reason, f"{metadata.uri}: {error}") from error
