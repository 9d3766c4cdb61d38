"""The agent's bag in memory; use it as `bagpipe.MemoryBag`. What parses a bag's tail is used by
`bagpipe.plan.bag_tail`, which decides what is read.
"""

from collections.abc import Iterator, Mapping, Sequence
from os import PathLike
from typing import Any, Literal, final

from typing_extensions import Buffer

Compression = Literal["none", "lz4", "bz2"]

class BagError(ValueError):
    """A bag can't be read or written; the text names the byte offset and what was expected."""

@final
class Connection:
    """One publisher of one topic, as it was recorded."""

    @property
    def id(self) -> int: ...
    @property
    def topic(self) -> str: ...
    @property
    def type(self) -> str:
        """Such as sensor_msgs/Imu; rosbags calls it sensor_msgs/msg/Imu."""
    @property
    def md5sum(self) -> str: ...
    @property
    def definition(self) -> str: ...
    @property
    def callerid(self) -> str | None: ...
    @property
    def latching(self) -> bool:
        """Whether the publisher latched its last message: in ROS 2, transient local."""
    @property
    def in_force(self) -> int:
        """How many of its last messages a subscriber that joins late gets."""
    @property
    def encoding(self) -> str:
        """What its messages' bytes are: ros1, cdr or another."""
    @property
    def schema_encoding(self) -> str:
        """What the definition is written in: ros1msg, ros2msg, ros2idl or another."""
    @property
    def offered_qos(self) -> str | None:
        """The publishers' quality of service, as ROS 2's recorder wrote it down (YAML)."""

@final
class Damage:
    """What a damaged or truncated bag has lost."""

    @property
    def offset(self) -> int:
        """Byte offset of the first damage in the file."""
    @property
    def bytes(self) -> int:
        """Bytes that could not be used."""
    @property
    def messages(self) -> int | None:
        """Messages that are lost; None when nobody can know."""
    @property
    def description(self) -> str: ...

@final
class Checked:
    """What a look at every record has found."""

    @property
    def sound(self) -> bool:
        """True when nothing is lost and nothing contradicts itself."""
    @property
    def messages(self) -> int:
        """Whole messages."""
    @property
    def damage(self) -> Damage | None: ...
    @property
    def problems(self) -> list[str]:
        """Sentences about what contradicts itself."""

@final
class Messages(Iterator[tuple[Connection, int, memoryview]]):
    """Messages of a bag, as (connection, time in ns, raw)."""

    def __iter__(self) -> Messages: ...
    def __next__(self) -> tuple[Connection, int, memoryview]: ...
    def __length_hint__(self) -> int:
        """How many messages are left."""

@final
class MemoryBag:
    """A ROS 1 bag (format 2.0) in memory. Threads may share it."""

    def __new__(
        cls,
        data: Buffer,
        *,
        decompressed_bytes: int | None = None,
        mcap_topics: Sequence[str] | None = None,
    ) -> MemoryBag:
        """Opens the bag that lies in `data`. `bytes` are not copied; any other buffer is,
        because it may change. Of a damaged bag what is whole is kept, see `damage`.
        `decompressed_bytes` bounds the memory of all uncompressed chunks together. Of MCAP the
        bag is made of `mcap_topics` alone (none: of all); other data has all that it holds.
        Raises BagError."""
    @staticmethod
    def open(path: str | PathLike[str], *, decompressed_bytes: int | None = None) -> MemoryBag:
        """Reads a file into memory and opens it. Raises OSError and BagError."""
    @staticmethod
    def writer(
        *, compression: Compression = "none", byte_budget: int | None = None
    ) -> MemoryBagWriter:
        """A new bag to write into; the finished bag has at most `byte_budget` bytes."""
    @staticmethod
    def merge(
        bags: Sequence[MemoryBag],
        *,
        compression: Compression = "none",
        byte_budget: int | None = None,
    ) -> MemoryBag:
        """All messages of all bags by time; those of the same time in the bags' order.
        Raises BagError, also for a damaged bag."""
    def slice(
        self,
        start: int | None = None,
        end: int | None = None,
        topics: Sequence[str] | None = None,
        *,
        compression: Compression = "none",
        byte_budget: int | None = None,
    ) -> MemoryBag:
        """Messages with start <= time < end (ns), and before them, at `start`, each publisher's
        last latched message from before. Chunks that lie inside as a whole stay as they are.
        Raises BagError, also for a damaged bag or a topic that the bag does not have."""
    def messages(
        self,
        topics: Sequence[str] | None = None,
        start: int | None = None,
        end: int | None = None,
    ) -> Messages:
        """Messages with start <= time < end (ns), by time, then chunk, then offset. Each raw
        message is a read-only view of the bag's memory, which lives as long as the view.
        Raises BagError, also for a topic that the bag does not have."""
    def check(self) -> Checked:
        """Reads every record and compares what it finds with the index. Raises BagError."""
    @property
    def connections(self) -> list[Connection]: ...
    @property
    def topics(self) -> list[str]:
        """The topics' names, sorted."""
    @property
    def start(self) -> int | None:
        """The time of the first message in ns; None without messages."""
    @property
    def end(self) -> int | None:
        """The time of the last message in ns; None without messages."""
    @property
    def message_count(self) -> int:
        """Whole messages."""
    @property
    def chunk_count(self) -> int: ...
    @property
    def compressions(self) -> list[str]:
        """The compressions of its chunks, sorted: none, lz4, bz2."""
    @property
    def damage(self) -> Damage | None:
        """What was lost to damage; None when the bag is whole as far as it has been read."""
    def view(self) -> memoryview:
        """The bag's file as it lies in memory, not copied."""
    def to_bytes(self) -> bytes:
        """The bag's file: a copy, but for a bag that was opened from bytes."""

@final
class MemoryBagWriter:
    """Writes messages into a bag in memory. Made by MemoryBag.writer."""

    def write(
        self,
        topic: str,
        time_ns: int,
        raw: Buffer,
        *,
        type: str,  # noqa: A002 (the name that bags give it)
        md5sum: str,
        definition: str,
        callerid: str | None = None,
        latching: bool = False,
    ) -> None:
        """Appends a serialised message; its connection follows from the other arguments.
        Raises BagError when the bag would exceed its budget; it can still be finished then."""
    @property
    def message_count(self) -> int:
        """Messages written so far."""
    @property
    def high_water(self) -> int:
        """The most bytes that the bag, finished then, would have had at any time."""
    def finish(self) -> MemoryBag:
        """Writes the index and gives the bag; nothing can be written after that."""

@final
class MemoryMcap:
    """An MCAP file in memory, whose messages stay as they are. Threads may share it."""

    def __new__(cls, data: Buffer, *, decompressed_bytes: int | None = None) -> MemoryMcap:
        """Opens a copy of `data`. Of a damaged file what is whole is kept, see `damage`.
        `decompressed_bytes` bounds the memory of all uncompressed chunks together.
        Raises BagError."""
    def messages(
        self,
        topics: Sequence[str] | None = None,
        start: int | None = None,
        end: int | None = None,
    ) -> McapMessages:
        """Messages with start <= time < end (ns), by time, then as they lie in the file; of
        topics that the file has, and none of others. Each raw message is a read-only view of the
        file's memory, which lives as long as the view. Raises BagError for a chunk that is
        damaged, or above the bound."""
    @property
    def connections(self) -> list[Connection]: ...
    @property
    def topics(self) -> list[str]:
        """The topics' names, sorted."""
    @property
    def damage(self) -> Damage | None:
        """What was lost to damage; None when the file is whole as far as it has been read."""

@final
class MemoryMcapWriter:
    """Writes messages of recorded connections into MCAP in memory."""

    def __new__(cls, *, byte_budget: int | None = None) -> MemoryMcapWriter:
        """An empty file; the finished one has at most `byte_budget` bytes."""
    def write(self, connection: Connection, time_ns: int, raw: bytes) -> None:
        """Appends a serialised message; connections that differ in their ids alone are one channel.
        Raises BagError when the file would exceed its budget."""
    def finish(self) -> bytes:
        """Writes the summary and gives the file; nothing can be written after that."""

@final
class McapMessages(Iterator[tuple[Connection, int, memoryview]]):
    """Messages of MCAP, as (connection, time in ns, raw)."""

    def __iter__(self) -> McapMessages: ...
    def __next__(self) -> tuple[Connection, int, memoryview]: ...
    def __length_hint__(self) -> int:
        """How many messages are left."""

class TailError(ValueError):
    """A bag can't be planned: `args` are a reason in CamelCase and a sentence."""

# index_pos, conn_count, chunk_count
_Head = tuple[int, int, int]
# id, topic, type, caller id, encoding, how many messages late subscribers get, the publishers'
# quality of service as ROS 2 recorded it, offset, length
_Publisher = tuple[int, str, str, str, str, int, str, int, int]
# offset, end, start and end time in ns, messages for each connection, where its index begins and
# how it is compressed (None: its own record says that)
_Span = tuple[int, int, int, int, dict[int, int], int | None, str | None]
# (offset, length) of what precedes chunks, and whether the messages of each channel are counted
_Index = tuple[list[tuple[int, int]], list[_Publisher], list[_Span], bool]

# Each raises TailError; `base` and `offset` are where the bytes lie in the file.
def parse_head(data: bytes, size: int) -> _Head:
    """The file header record in the bytes with which a file of `size` bytes begins."""

def bag_index(data: bytes, head: _Head) -> _Index:
    """All bytes of the file from index_pos on."""

def mcap_head(data: bytes) -> int:
    """Where the head of an MCAP file ends, in the bytes with which it begins."""

def mcap_footer(data: bytes, size: int) -> tuple[int, int]:
    """Where the summary begins and ends; `data` are the last 37 bytes of a file of `size` bytes."""

def mcap_index(data: bytes, base: int, head_end: int, footer: bytes) -> _Index:
    """All bytes of the summary; `footer` is what `mcap_footer` took."""

def mcap_index_times(data: bytes, base: int) -> dict[int, list[int]]:
    """Times in ns that message indexes of MCAP name, for each channel."""

def chunk_compression(data: bytes, base: int) -> str:
    """What the header of the CHUNK record names, with which the bytes begin."""

def chunk_length(data: bytes, base: int) -> int | None:
    """Bytes of the whole CHUNK record by its header; None where `data` ends too early to say."""

def index_times(data: bytes, base: int) -> dict[int, list[int]]:
    """Times in ns that INDEX records name, for each connection."""

def split_record(data: bytes, at: int, base: int) -> tuple[dict[str, bytes], int, int]:
    """Fields of the record at `at`, and where its data begins and ends in `data`."""

def different_field(datatype: str, one: str, other: str) -> tuple[str, str] | None:
    """The first field that two definitions of a type have differently, as each of them has it.

    None where their messages are laid out alike, and where a definition is empty or in IDL.
    """

def connection_fields(record: bytes, offset: int) -> dict[str, bytes]:
    """What a CONNECTION record says of its publisher."""

# A recording's version, storage (mcap, sqlite3), files, what is compressed (none, file, message),
# messages, and of each topic its type, encoding and messages.
_Metadata = tuple[int, str, list[str], str, int, list[tuple[str, str, str, int]]]

# Each raises TailError.
def rosbag2_metadata(text: bytes) -> _Metadata:
    """The text of a folder's metadata.yaml; its files are below the folder."""

def database_rows(
    path: str | PathLike[str], text: bytes, most_times: int
) -> tuple[list[_Publisher], list[tuple[int, int, dict[int, int], bytes]]]:
    """A file of SQLite of rosbag2: its topics, and stretches of messages with their first and last
    time in ns, how many of each topic, and where the file has at most `most_times` messages the
    time of each as an integer of 8 bytes in the machine's own order, of one topic after the other;
    `text` is the folder's metadata.yaml."""

def uncompress_file(source: str | PathLike[str], target: str | PathLike[str], most: int) -> int:
    """Uncompresses zstd into a new file of at most `most` bytes; its length. OSError, too."""

def joined_mcap(
    files: Sequence[bytes | str | PathLike[str]],
    text: bytes,
    start: int,
    end: int,
    topics: Sequence[str],
    *,
    late: Mapping[str, tuple[bool | None, int | None]],
    memory: int,
) -> bytes:
    """One file of MCAP of files that follow each other: MCAP's bytes, or paths of a folder's files.

    It has the messages of the topics (none: of all) with start <= t < end (ns), and what is latched
    and in force before, at its own time. `late` has of a topic whether it latches and how many
    messages late subscribers get; None: as recorded. Raises BagError.
    """

# Bytes, messages in them, and what was lost.
_Written = tuple[bytes, int, Damage | None]

# Recordings of this machine, of every format. Each raises OSError and BagError; `memory` bounds
# what is read of each and again what it holds uncompressed, in bytes.
def recording_kind(path: str | PathLike[str]) -> Literal["bag", "mcap", "database", "folder"]:
    """By a file's first bytes; bytes of no known format are a bag's."""

def describe_recording(path: str | PathLike[str], memory: int) -> dict[str, Any]:
    """What is in a recording that is no bag: files, bytes, times, messages, chunks, compressions,
    topics (name, type, encoding, messages) and damage."""

def check_recording(path: str | PathLike[str], memory: int) -> Checked:
    """Reads every record of one that is no bag."""

def slice_recording(
    path: str | PathLike[str],
    start: int,
    end: int,
    topics: Sequence[str] | None,
    *,
    compression: str,
    memory: int,
) -> _Written:
    """A part of one that is no bag as MCAP, and at its start what was latched then."""

def merge_recordings(
    paths: Sequence[str | PathLike[str]], *, compression: str, memory: int
) -> _Written:
    """Several that are no bags as MCAP."""

def mend_recording(path: str | PathLike[str], *, compression: str, memory: int) -> _Written:
    """What is whole, with an index: of a bag a bag, of all else MCAP."""

def jpeg_pixels(data: bytes, side: int) -> tuple[int, int, int, int, int, bytes]:
    """`(width, height, rows, columns, channels, pixels)` of at most `side` rows and columns.

    `width` and `height` are the picture's own; `channels` is 1 for grey, 3 for red, green and blue.
    At most 16,777,216 pixels, or 8,388,608 if it is progressive, are unpacked, for which some
    150 MiB are taken for a moment. Raises ValueError, whose text says why there are none.
    """

def convert_recording(
    path: str | PathLike[str], target: str, *, compression: str, memory: int
) -> _Written:
    """The same messages as a file of the name `target`, which ends in .bag or .mcap."""
