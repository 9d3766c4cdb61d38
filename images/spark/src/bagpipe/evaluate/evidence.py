"""What a case left behind, as the criteria see it: messages of a topic, decoded when asked for.

window.py decides which of them belong to the case's window.
"""

import itertools
import statistics
import struct
from collections.abc import Callable, Collection
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, NamedTuple

from rosbags.interfaces import Nodetype
from rosbags.typesys import Stores, get_types_from_msg, get_typestore
from rosbags.typesys.store import Typestore

import bagpipe
from bagpipe.evaluate.finding import NoEvidenceError

_HEADER, _OLD_HEADER = "std_msgs/msg/Header", "roslib/msg/Header"
_TIME = "builtin_interfaces/msg/Time"
# Of a message that begins with a header: its sequence number, then the stamp.
_SEQUENCE, _STAMP = 4, struct.Struct("<II")
# Between inputs: a silence that is longer than half a second and ten usual steps is a gap.
_LEAST_GAP, _GAP_STEPS = 500_000_000, 10
Bytes = Callable[[], bytes]


def nanoseconds(time: Any) -> int:
    """A time of a message in ns. ROS 1 counts its seconds without a sign, up to the year 2106;
    rosbags reads them with one.
    """
    seconds = int(time.sec)
    if getattr(time, "__msgtype__", _TIME) == _TIME:
        seconds &= 0xFFFFFFFF
    return seconds * 1_000_000_000 + int(time.nanosec)


class Sample(NamedTuple):
    """One message: when it was received in ns, and its decoded value."""

    time: int
    message: Any

    @property
    def stamp(self) -> int | None:
        """The header's stamp in ns; None where the type has no header."""
        header = getattr(self.message, "header", None)
        if header is None:
            return None
        return nanoseconds(header.stamp)


class Received(NamedTuple):
    """One message as it came: receipt in ns, its bytes, and what its header says, if it has one."""

    time: int
    raw: memoryview
    connection: Any
    stamp: int | None

    @property
    def identity(self) -> object:
        """Equal for messages that differ in nothing but `header.seq`; a message without a stamp
        is like no other.
        """
        return (self.stamp, hash(bytes(self.raw[_SEQUENCE:]))) if self.stamp else id(self)


class Recording:
    """One bag, of the stack or of the job's source; its bytes are read when first asked for.

    Where these are MCAP, messages of other `topics` may be of any encoding (None: of none).
    """

    def __init__(
        self, read: Bytes, start: int, end: int | None, topics: Collection[str] | None = None
    ) -> None:
        self._read = read
        self._start = start
        self._end = end
        self._topics = None if topics is None else sorted(topics)
        self._samples: dict[str, list[Sample]] = {}
        self._received: dict[str, list[Received]] = {}

    @cached_property
    def _bag(self) -> "bagpipe.MemoryBag":
        # By its package: the program for people is installed without the native module, too.
        return bagpipe.MemoryBag(self._read(), mcap_topics=self._topics)

    def to_bytes(self) -> bytes:
        """The whole bag."""
        return self._bag.to_bytes()

    @property
    def topics(self) -> list[str]:
        """The topics that the bag has messages on."""
        return sorted(self._bag.topics)

    def received(self, topic: str) -> list[Received]:
        """All messages as they came; empty where the topic is not there."""
        if topic not in self._received:
            headers: dict[int, bool] = {}
            found = []
            for connection, time, raw in self._messages(topic):
                if connection.id not in headers:
                    headers[connection.id] = _begins_with_header(connection)
                stamp = _stamp(raw) if headers[connection.id] else None
                found.append(Received(time, raw, connection, stamp))
            self._received[topic] = found
        return self._received[topic]

    def times(self, topic: str) -> list[int]:
        """Receipt times in ns, ascending; empty where the topic is not there."""
        return [each.time for each in self.received(topic)]

    def samples(self, topic: str) -> list[Sample]:
        """All messages, decoded by the definitions in the bag, in the order of `received`.

        Raises NoEvidenceError where there is none or one can't be decoded.
        """
        if topic not in self._samples:
            self._samples[topic] = self._decoded(topic)
        return self._samples[topic]

    def _messages(self, topic: str) -> Any:
        if topic not in self._bag.topics:
            return ()
        return self._bag.messages(topics=[topic], start=self._start, end=self._end)

    def _decoded(self, topic: str) -> list[Sample]:
        if topic not in self._bag.topics:
            there = ", ".join(self.topics[:10]) or "nothing"
            raise NoEvidenceError(f"no message on {topic} was recorded; there is {there}")
        types: dict[int, tuple[Typestore, str]] = {}
        found = []
        for time, raw, connection, _ in self.received(topic):
            if connection.id not in types:
                types[connection.id] = _store(connection)
            store, name = types[connection.id]
            try:
                found.append(Sample(time, store.deserialize_ros1(bytes(raw), name)))
            except Exception as error:  # a library's many faults at hostile bytes
                raise NoEvidenceError(
                    f"a message on {topic} at {time / 1e9:.3f} s can't be read as"
                    f" {connection.type}: {error}"
                ) from error
        if not found:
            raise NoEvidenceError(f"no message on {topic} was recorded in the case's window")
        return found


def _begins_with_header(connection: Any) -> bool:
    name = _name(connection)
    try:
        fields = get_types_from_msg(connection.definition, name)[name][1]
    except Exception:  # noqa: BLE001  a definition of any text; who decodes its messages says so
        return False
    return bool(fields) and fields[0][1] in {
        (Nodetype.NAME, _HEADER),
        (Nodetype.NAME, _OLD_HEADER),
    }


def _stamp(raw: memoryview) -> int | None:
    if len(raw) < _SEQUENCE + _STAMP.size:
        return None
    seconds, nanoseconds_ = _STAMP.unpack_from(raw, _SEQUENCE)
    return int(seconds) * 1_000_000_000 + int(nanoseconds_)


def _name(connection: Any) -> str:
    name: str = connection.type
    return name if "/msg/" in name else name.replace("/", "/msg/")


def _store(connection: Any) -> tuple[Typestore, str]:
    name = _name(connection)
    store = get_typestore(Stores.EMPTY)
    try:
        types = get_types_from_msg(connection.definition, name)
        # Before ROS Diamondback the header lived in roslib; definitions say "Header" of both.
        if _OLD_HEADER in types:
            types.setdefault(_HEADER, types[_OLD_HEADER])
        store.register(types)
    except Exception as error:  # a library's many faults at a definition of any text
        raise NoEvidenceError(
            f"the definition of {connection.type} on {connection.topic} can't be read: {error}"
        ) from error
    return store, name


@dataclass(frozen=True)
class Evidence:
    """All that the criteria of one case may look at.

    `result` is the agent's RESULT map, `start` and `end` the case's window in ns of bag time,
    `lead_in_start` where the play began (None: with the window). With `paced` false bag time
    runs ahead of the stack (playback.mode: max), and the time of a receipt says little. `inputs`
    says when inputs were recorded, ascending, and is asked only in doubt (None: all the time).
    """

    recorded: Recording
    source: Recording
    start: int
    end: int
    result: dict[str, Any] = field(default_factory=dict)
    values: dict[str, Any] = field(default_factory=dict)
    lead_in_start: int | None = None
    paced: bool = True
    inputs: Callable[[], list[int]] | None = None

    @property
    def led_in(self) -> bool:
        """Whether something was played before the window."""
        return self.lead_in_start is not None and self.lead_in_start < self.start

    @cached_property
    def _input_stretches(self) -> list[tuple[int, int]]:
        """From first to last input, without the recording's gaps."""
        if self.inputs is None:
            return [(self.start, self.end)]
        times = self.inputs()
        steps = list(itertools.pairwise(times))
        usual = statistics.median(after - before for before, after in steps) if steps else 0
        most = max(_LEAST_GAP, _GAP_STEPS * usual)
        cuts = [at + 1 for at, (before, after) in enumerate(steps) if after - before > most]
        edges = itertools.pairwise([0, *cuts, len(times)])
        return [(times[first], times[last - 1]) for first, last in edges if last > first]

    def input_time_between(self, start: int, end: int) -> int:
        """How long inputs came between two times, in ns: a recording may have gaps, in which nobody
        can be expected to answer.
        """
        stretches = self._input_stretches
        return sum(max(0, min(end, last) - max(start, first)) for first, last in stretches)

    @property
    def seconds(self) -> float:
        """Length of the window."""
        return (self.end - self.start) / 1e9
