"""What recordings show: topics, how often and how large, and how many bytes a time of them has."""

import itertools
import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field

from bagpipe.engine_fields import engines_by_encoding

_SECOND = 1_000_000_000


@dataclass(frozen=True)
class Sample:
    """What a few of a topic's messages show: how many they are, their bytes as they are played, and
    for each that has one the age of its header's stamp at its receipt, in ns.
    """

    messages: int = 0
    bytes: int = 0
    ages: tuple[int, ...] = ()

    def __add__(self, other: "Sample") -> "Sample":
        return Sample(
            self.messages + other.messages, self.bytes + other.bytes, self.ages + other.ages
        )


@dataclass(frozen=True)
class Topic:
    """One topic of one recording, or of several: names as they were recorded, which may be of any
    letters; `seconds` is how long the recordings last that have it.
    """

    name: str
    types: frozenset[str]
    encodings: frozenset[str]
    messages: int
    latched: bool
    seconds: float
    sample: Sample = Sample()

    @property
    def rate(self) -> float | None:
        """Messages per second; None where the index says none: below two, or of no length."""
        return self.messages / self.seconds if self.messages > 1 and self.seconds > 0 else None

    @property
    def bytes_each(self) -> float | None:
        """Of a message, as far as some were read."""
        return self.sample.bytes / self.sample.messages if self.sample.messages else None

    def joined(self, other: "Topic") -> "Topic":
        """The same topic in both."""
        return Topic(
            self.name,
            self.types | other.types,
            self.encodings | other.encodings,
            self.messages + other.messages,
            self.latched or other.latched,
            self.seconds + other.seconds,
            self.sample + other.sample,
        )


@dataclass(frozen=True)
class Course:
    """How a topic came within the fragments of a recording: of the slowest of them the messages per
    second, the longest silence in any in seconds, and how many fragments had none.
    """

    slowest: float
    longest_gap: float
    fragments: int
    silent: int

    def joined(self, other: "Course") -> "Course":
        """Over the fragments of both."""
        return Course(
            min(self.slowest, other.slowest),
            max(self.longest_gap, other.longest_gap),
            self.fragments + other.fragments,
            self.silent + other.silent,
        )


@dataclass(frozen=True)
class Stretch:
    """Bytes as they are stored, of messages from `start` to `end`, in ns."""

    start: int
    end: int
    bytes: int


@dataclass(frozen=True)
class Looked:
    """One recording; times in ns, None where it does not say them.

    `growth` is how many times the bytes grow when they are uncompressed, 0 where they are not
    compressed and stay where they lie, None where it is not known.
    """

    uri: str
    kind: str
    bytes: int
    start: int | None
    end: int | None
    topics: dict[str, Topic]
    stretches: tuple[Stretch, ...] = ()
    growth: float | None = None
    basis: str = "index"
    courses: dict[str, Course] = field(default_factory=dict)

    @property
    def seconds(self) -> float:
        """From its first to its last message."""
        return 0.0 if self.start is None or self.end is None else (self.end - self.start) / _SECOND


@dataclass(frozen=True)
class Recordings:
    """All that was looked at. `named` is how many there are, `refused` a sentence for each that
    can't be played.
    """

    looked: list[Looked]
    named: int
    refused: list[str]

    @property
    def topics(self) -> dict[str, Topic]:
        """Those of all, by their names, sorted."""
        found: dict[str, Topic] = {}
        for topic in itertools.chain.from_iterable(each.topics.values() for each in self.looked):
            known = found.get(topic.name)
            found[topic.name] = topic if known is None else known.joined(topic)
        return dict(sorted(found.items()))

    @property
    def seconds(self) -> float:
        """Of all that were looked at."""
        return sum(each.seconds for each in self.looked)

    @property
    def longest(self) -> float:
        """Seconds of the longest."""
        return max((each.seconds for each in self.looked), default=0.0)

    @property
    def growth(self) -> float | None:
        """The greatest of all; None where one is not known."""
        known = [each.growth for each in self.looked]
        return max((each for each in known if each is not None), default=None)

    def course(self, topic: str) -> Course | None:
        """Of a topic in all recordings whose index says when it came."""
        found = [each.courses[topic] for each in self.looked if topic in each.courses]
        return None if not found else _all_joined(found)

    def peak(self, length: float, warm_up: float) -> int:
        """The bytes, as stored, that the fullest fragment of so many seconds needs.

        Where a recording does not say where its bytes lie in time, they are spread evenly.
        """
        window, lead_in = round(length * _SECOND), round(warm_up * _SECOND)
        return max((_peak(each, window, lead_in) for each in self.looked), default=0)


def engine_of(topics: Iterable[Topic]) -> str | None:
    """The engine that plays most of the topics; None where no engine of ROS plays one."""
    engines = engines_by_encoding()
    counts = dict.fromkeys(engines, 0)
    for topic in topics:
        if topic.messages and len(topic.encodings) == 1:
            for encoding in topic.encodings & counts.keys():
                counts[encoding] += 1
    best = max(counts, key=lambda encoding: counts[encoding])
    return engines[best] if counts[best] else None


def course_in(times: Sequence[int], windows: Iterable[tuple[int, int]]) -> Course | None:
    """How ascending `times` in ns lie in windows; None where there is no window of any length."""
    found: Course | None = None
    at = 0
    for start, end in windows:
        if end <= start:
            continue
        while at < len(times) and times[at] < start:
            at += 1
        begun = at
        while at < len(times) and times[at] < end:
            at += 1
        inside = times[begun:at]
        steps = [b - a for a, b in itertools.pairwise([start, *inside, end])]
        rate = len(inside) * _SECOND / (end - start)
        course = Course(rate, max(steps) / _SECOND, 1, int(not inside))
        found = course if found is None else found.joined(course)
    return found


def percentile(values: Sequence[int], share: float) -> int:
    """The value that a share (0 to 1) of them does not exceed: nearest rank, as criteria do it."""
    return sorted(values)[max(0, math.ceil(share * len(values)) - 1)]


def _all_joined(courses: Sequence[Course]) -> Course:
    joined = courses[0]
    for each in courses[1:]:
        joined = joined.joined(each)
    return joined


def _peak(looked: Looked, window: int, lead_in: int) -> int:
    if looked.start is None or not looked.stretches:
        length = looked.seconds * _SECOND
        whole = length <= window + lead_in
        return looked.bytes if whole else math.ceil(looked.bytes * (window + lead_in) / length)
    steps = sorted(_steps(looked.stretches, looked.start, window, lead_in))
    return max(itertools.accumulate(change for _, change in steps))


def _steps(
    stretches: Iterable[Stretch], begin: int, window: int, lead_in: int
) -> Iterator[tuple[int, int]]:
    """(number of a window, change of its bytes): each stretch from its first window to behind its
    last, so that one that lasts for centuries takes no longer than another.
    """
    for each in stretches:
        first = max(0, (each.start - begin) // window)
        last = max(first, (each.end - begin + lead_in) // window)
        yield first, each.bytes
        yield last + 1, -each.bytes
