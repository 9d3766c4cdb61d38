"""What a case left behind, as the criteria see it: messages of a topic, decoded when asked for.

Only messages in the case's window count: what a stack says to its lead-in is not judged.
"""

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, NamedTuple

from rosbags.typesys import Stores, get_types_from_msg, get_typestore
from rosbags.typesys.store import Typestore

import bagpipe
from bagpipe.evaluate.finding import NoEvidenceError

_HEADER, _OLD_HEADER = "std_msgs/msg/Header", "roslib/msg/Header"
Bytes = Callable[[], bytes]


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
        return int(header.stamp.sec) * 1_000_000_000 + int(header.stamp.nanosec)


class Recording:
    """One bag, of the stack or of the job's source; its bytes are read when first asked for."""

    def __init__(self, read: Bytes, start: int, end: int | None) -> None:
        self._read = read
        self._start = start
        self._end = end
        self._samples: dict[str, list[Sample]] = {}

    @cached_property
    def _bag(self) -> "bagpipe.MemoryBag":
        # By its package: the program for people is installed without the native module, too.
        return bagpipe.MemoryBag(self._read())

    def to_bytes(self) -> bytes:
        """The whole bag."""
        return self._bag.to_bytes()

    @property
    def topics(self) -> list[str]:
        """The topics that the bag has messages on."""
        return sorted(self._bag.topics)

    def times(self, topic: str) -> list[int]:
        """Receipt times in ns, ascending; empty where the topic is not there."""
        if topic not in self._bag.topics:
            return []
        return [time for _, time, _ in self._messages(topic)]

    def samples(self, topic: str) -> list[Sample]:
        """All messages, decoded by the definitions in the bag.

        Raises NoEvidenceError where there is none or one can't be decoded.
        """
        if topic not in self._samples:
            self._samples[topic] = self._decoded(topic)
        return self._samples[topic]

    def _messages(self, topic: str) -> Any:
        return self._bag.messages(topics=[topic], start=self._start, end=self._end)

    def _decoded(self, topic: str) -> list[Sample]:
        if topic not in self._bag.topics:
            there = ", ".join(self.topics[:10]) or "nothing"
            raise NoEvidenceError(f"no message on {topic} was recorded; there is {there}")
        types: dict[int, tuple[Typestore, str]] = {}
        found = []
        for connection, time, raw in self._messages(topic):
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


def _store(connection: Any) -> tuple[Typestore, str]:
    name = connection.type
    name = name if "/msg/" in name else name.replace("/", "/msg/")
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

    `result` is the agent's RESULT map, `start` and `end` the case's window in ns of bag time.
    """

    recorded: Recording
    source: Recording
    start: int
    end: int
    result: dict[str, Any] = field(default_factory=dict)
    values: dict[str, Any] = field(default_factory=dict)

    @property
    def seconds(self) -> float:
        """Length of the window."""
        return (self.end - self.start) / 1e9
