"""What a folder of rosbag2 says of itself: its metadata.yaml.

Format: https://github.com/ros2/rosbag2, metadata.yaml of versions 4 to 9.
"""

import posixpath
from dataclasses import dataclass
from functools import partial

from bagpipe.plan import bag_tail
from bagpipe.plan.bag_tail import BagError
from bagpipe.storage import Storage
from bagpipe.topic_names import resolve

METADATA = "metadata.yaml"
# A longer one is refused; rosbag2 writes about a kilobyte for each topic.
MOST_METADATA_BYTES = 4 << 20

parsed = partial(bag_tail.parsed, user="reading a folder of rosbag2")


@dataclass(frozen=True)
class Metadata:
    """What metadata.yaml says; `text` is the file itself.

    `files` are URIs in the recording's order. `storage` is mcap or sqlite3, `compressed` none, file
    or message. `encodings` are those of the topics by their resolved names.
    """

    uri: str
    version: str
    text: bytes
    storage: str
    compressed: str
    files: list[str]
    messages: int
    encodings: dict[str, str]

    @property
    def by_ranges(self) -> bool:
        """Whether a file's summary says which bytes are needed."""
        return self.storage == "mcap" and self.compressed != "file"

    @property
    def as_stored(self) -> bool:
        """Whether the chunks of a file are those of the recording, so that they can be sent."""
        return self.storage == "mcap" and self.compressed == "none"


def is_folder(uri: str) -> bool:
    """Whether a URI names a folder of rosbag2, by its metadata."""
    return posixpath.basename(uri) == METADATA


def read_metadata(uri: str, storage: Storage, folder_version: str = "") -> Metadata:
    """The metadata at a URI, as it was when the folder had this version, if one is given.

    Raises BagError and StorageError.
    """
    file = storage.open(uri, folder_version.rpartition(":")[0])
    if file.size > MOST_METADATA_BYTES:
        raise BagError(
            "BagUnreadable", f"it has {file.size} bytes, expected at most {MOST_METADATA_BYTES}"
        )
    text = file.read(0, file.size)
    _, kind, files, compressed, messages, topics = parsed("rosbag2_metadata", text)
    folder = uri.removesuffix(METADATA)
    return Metadata(
        uri,
        file.version,
        text,
        kind,
        compressed,
        [folder + name for name in files],
        messages,
        {resolve(topic): encoding for topic, _, encoding, _ in topics},
    )
