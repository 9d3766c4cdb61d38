"""What a case left behind, as the criteria see it: messages of a topic, decoded when asked for.

window.py decides which of them belong to the case's window.
"""

import bisect
import itertools
import math
import statistics
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, Generic, NamedTuple, TypeVar

import bagpipe
from bagpipe.evaluate.decoding import decoder, sequence_at, stamp_reader
from bagpipe.evaluate.finding import NoEvidenceError
from bagpipe.recording_format import in_memory
from bagpipe.topic_names import resolve

# In bytes: the sequence number of a header of ROS 1, or the head of CDR.
_SEQUENCE = 4
# Between inputs: a silence that is longer than half a second and ten usual steps is a gap.
_LEAST_GAP, _GAP_STEPS = 500_000_000, 10
# Inputs that come together, as those of a stereo camera: with a step as short as this or none
# the least gap is the same.
_TOGETHER = _LEAST_GAP // _GAP_STEPS
Bytes = Callable[[], bytes]
# From one time to another in ns (start <= t < end): by topic of each input's time and stamp.
InputStamps = Callable[[int, int], Mapping[str, list[tuple[int, int]]]]
Made = TypeVar("Made")


class _Pair(NamedTuple):
    time: int
    message: Any


class Sample(_Pair):
    """One message: when it was received in ns, and its decoded value.

    A user's evaluator takes it for these two; `stamp` is its header's in ns, None without one.
    """

    stamp: int | None = None

    @classmethod
    def of(cls, received: "Received", message: Any) -> "Sample":
        """Of a message that came, with its value."""
        made = cls(received.time, message)
        made.stamp = received.stamp
        return made


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
        if not self.stamp:
            return id(self)
        at = sequence_at(self.connection)
        before, behind = (0, 0) if at is None else (at, at + _SEQUENCE)
        return self.stamp, hash(bytes(self.raw[:before])), hash(bytes(self.raw[behind:]))


class ForTypes(Generic[Made]):
    """What is made once for each type, however many connections a recording has of it."""

    def __init__(self, make: Callable[[Any], Made]) -> None:
        self._make = make
        self._of_connections: dict[int, Made] = {}
        self._of_types: dict[tuple[str, str, str, str], Made] = {}

    def of(self, connection: Any) -> Made:
        """Raises what making raises, for each connection again."""
        if connection.id not in self._of_connections:
            kind = (
                connection.type,
                connection.definition,
                connection.schema_encoding,
                connection.encoding,
            )
            if kind not in self._of_types:
                self._of_types[kind] = self._make(connection)
            self._of_connections[connection.id] = self._of_types[kind]
        return self._of_connections[connection.id]


class Recording:
    """One recording, of the stack or of the job's source; it is read when first asked for."""

    def __init__(self, read: Bytes, start: int, end: int | None) -> None:
        self._read = read
        self._start = start
        self._end = end
        self._samples: dict[str, list[Sample]] = {}
        self._received: dict[str, list[Received]] = {}
        self._stamp_readers = ForTypes(stamp_reader)
        self._decoders = ForTypes(decoder)

    @cached_property
    def _opened(self) -> "bagpipe.MemoryBag | bagpipe.MemoryMcap":
        opened: bagpipe.MemoryBag | bagpipe.MemoryMcap = in_memory(self._read())
        return opened

    def file(self) -> tuple[str, bytes]:
        """The ending of the whole file's name, and its bytes."""
        if isinstance(self._opened, bagpipe.MemoryBag):
            return ".bag", self._opened.to_bytes()
        return ".mcap", self._read()  # what is open of MCAP is no file any more

    @cached_property
    def _names(self) -> dict[str, list[str]]:
        """The names that each topic of the ROS graph has in the recording: some lack the slash."""
        names: dict[str, list[str]] = {}
        for name in self._opened.topics:
            names.setdefault(resolve(name), []).append(name)
        return names

    @property
    def topics(self) -> list[str]:
        """The topics that the recording has, as the ROS graph knows them."""
        return sorted(self._names)

    def received(self, topic: str) -> list[Received]:
        """All messages as they came; empty where the topic is not there.

        Raises NoEvidenceError for a recording that is damaged.
        """
        if topic not in self._received:
            found = []
            for connection, time, raw in self._messages(topic):
                stamp_of = self._stamp_readers.of(connection)
                found.append(Received(time, raw, connection, stamp_of(raw) if stamp_of else None))
            if (damage := self._opened.damage) is not None:
                raise NoEvidenceError(f"the recording is damaged: expected {damage.description}")
            self._received[topic] = found
        return self._received[topic]

    def times(self, topic: str) -> list[int]:
        """Receipt times in ns, ascending; empty where the topic is not there."""
        return [each.time for each in self.received(topic)]

    def samples(self, topic: str) -> list[Sample]:
        """All messages, decoded by the recording's definitions, in the order of `received`.

        Raises NoEvidenceError where there is none or one can't be decoded.
        """
        if topic not in self._samples:
            self._samples[topic] = self._decoded(topic)
        return self._samples[topic]

    def _messages(self, topic: str) -> Any:
        names = self._names.get(topic)
        if names is None:
            return ()
        return self._opened.messages(topics=names, start=self._start, end=self._end)

    def _decoded(self, topic: str) -> list[Sample]:
        if topic not in self._names:
            there = ", ".join(self.topics[:10]) or "nothing"
            raise NoEvidenceError(f"no message on {topic} was recorded; there is {there}")
        found = []
        for each in self.received(topic):
            connection = each.connection
            decode = self._decoders.of(connection)
            try:
                found.append(Sample.of(each, decode(each.raw)))
            except Exception as error:  # a library's many faults at hostile bytes
                raise NoEvidenceError(
                    f"a message on {topic} at {each.time / 1e9:.3f} s can't be read as"
                    f" {connection.type}: {error}"
                ) from error
        if not found:
            raise NoEvidenceError(f"no message on {topic} was recorded in the case's window")
        return found


@dataclass(frozen=True)
class Evidence:
    """All that the criteria of one case may look at.

    `result` is the agent's RESULT map, `start` and `end` the case's window in ns of bag time,
    `lead_in_start` where the play began (None: with the window). With `paced` false bag time
    runs ahead of the stack (playback.mode: max), and the time of a receipt says little. `rate` is
    how many seconds of bag time were played in one of real time. `inputs` says when inputs were
    recorded, ascending, and is asked only in doubt (None: all the time); so is `input_stamps`,
    which has topics with a header alone, and none where that would be costly (None: not known).
    """

    recorded: Recording
    source: Recording
    start: int
    end: int
    result: dict[str, Any] = field(default_factory=dict)
    values: dict[str, Any] = field(default_factory=dict)
    lead_in_start: int | None = None
    paced: bool = True
    rate: float = 1.0
    inputs: Callable[[], list[int]] | None = None
    input_stamps: InputStamps | None = None
    _measured: dict[int, tuple[object, Any]] = field(
        default_factory=dict, init=False, repr=False, compare=False
    )

    def real_seconds(self, delay: int) -> float:
        """How long a delay of so many ns of bag time took at the most.

        Of a part that lies in the recording, as between a stamp and its receipt there, nothing
        says how long it is: a play at another rate makes a stack no faster for it.
        """
        return delay / 1e9 / min(1.0, self.rate)

    def keep(self, wanted: object, measured: Any) -> None:
        """What was measured for a criterion: its course is drawn from it once more."""
        self._measured[id(wanted)] = (wanted, measured)

    def kept(self, wanted: object) -> Any:
        """What was measured for this very criterion; None where nothing was."""
        return self._measured.get(id(wanted), (wanted, None))[1]

    @property
    def led_in(self) -> bool:
        """Whether something was played before the window."""
        return self.lead_in_start is not None and self.lead_in_start < self.start

    @cached_property
    def _input_times(self) -> list[int]:
        """Those in the window; none where they are not known."""
        known = [] if self.inputs is None else self.inputs()
        return [each for each in known if self.start <= each < self.end]

    @cached_property
    def inputs_until(self) -> int:
        """To the window's end, or one usual step behind the last input."""
        times = self._input_times
        return min(self.end, times[-1] + math.ceil(_usual(times))) if times else self.end

    def inputs_thin_out(self, time: int) -> bool:
        """Whether fewer inputs came from a time on than in hardly any time before that was as long:
        one of several sensors may have stopped.
        """
        times, span = self._input_times, self.inputs_until - time
        before = bisect.bisect_left(times, time)
        usual = sorted(
            bisect.bisect_right(times, each + span) - at - 1
            for at, each in enumerate(times[:before])
            if each + span <= time
        )
        return bool(usual) and len(times) - before < usual[len(usual) // 10]

    @cached_property
    def _input_stretches(self) -> list[tuple[int, int]]:
        """From first to last input, without the recording's gaps."""
        whole = [(self.start, self.end)]  # what is not known forgives no silence
        times = self._input_times
        if not times:
            return whole
        most = max(_LEAST_GAP, _GAP_STEPS * _usual(times))
        steps = itertools.pairwise(times)
        cuts = [at + 1 for at, (before, after) in enumerate(steps) if after - before > most]
        edges = itertools.pairwise([0, *cuts, len(times)])
        stretches = [(times[first], times[last - 1]) for first, last in edges]
        return [(first, last) for first, last in stretches if last > first]

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


def _usual(times: list[int]) -> float:
    steps = steps_of(times)
    return statistics.median(steps) if steps else 0


def steps_of(times: list[int]) -> list[int]:
    """Between ascending times, in ns; of those that come together only the one to the first."""
    steps, first = [], times[0]
    for before, after in itertools.pairwise(times):
        if after - first >= _TOGETHER:
            steps.append(after - before)
            first = after
    return steps
