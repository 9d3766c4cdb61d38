"""Messages of MCAP and of folders of rosbag2, whose fragments are parts of files."""

from collections.abc import Iterator, Sequence
from typing import Any

from bagpipe.native import native
from bagpipe.plan.bag_tail import BagError
from bagpipe.plan.framing import framed
from bagpipe.plan.part import Part
from bagpipe.plan.rosbag2 import MOST_FRAGMENT_BYTES, joined
from bagpipe.plan.rosbag2_metadata import is_folder, read_metadata
from bagpipe.storage import Storage, StorageError
from bagpipe.topic_names import resolve

_PIECE_BYTES = 1 << 20


def opened(uri: str, parts: Sequence[Part], storage: Storage) -> Any:
    """The native module's MemoryMcap of a fragment. Raises StorageError."""
    try:
        if is_folder(uri):
            data = joined(parts, read_metadata(uri, storage), storage, {})
        else:
            (part,) = parts
            if part.bytes > MOST_FRAGMENT_BYTES:
                raise BagError("BagUnreadable", "the fragment is above 1 GiB: choose shorter ones")
            sources = part.connections + part.ranges
            pieces = storage.pieces(uri, sources, _PIECE_BYTES, part.version)
            data = b"".join(framed(sources, pieces, part.stated))
        mcap = native("MemoryMcap", "reading MCAP")(data, decompressed_bytes=MOST_FRAGMENT_BYTES)
    except (BagError, ValueError) as error:
        raise StorageError(f"{uri}: {error}") from error
    if (damage := mcap.damage) is not None:
        raise StorageError(f"{uri}: expected {damage.description}")
    return mcap


def wanted(mcap: Any, parts: Sequence[Part]) -> list[str]:
    """The fragment's topics, as they were recorded."""
    topics = parts[0].topics
    return [topic for topic in mcap.topics if not topics or resolve(topic) in topics]


def in_window(uri: str, parts: Sequence[Part], storage: Storage) -> Iterator[tuple[Any, int, Any]]:
    """(connection, time in ns, bytes) of the fragment's messages, by time. Raises StorageError."""
    mcap, window = opened(uri, parts, storage), parts[0].window
    try:
        yield from mcap.messages(wanted(mcap, parts), window.start, window.end)
    except ValueError as error:
        raise StorageError(f"{uri}: {error}") from error
