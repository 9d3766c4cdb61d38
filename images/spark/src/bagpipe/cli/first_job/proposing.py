"""The job that follows from what recordings show, before it is written: pure."""

import difflib
import math
import re
from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import Any

from bagpipe.cli.first_job.facts import Course, Recordings, Topic, engine_of, percentile
from bagpipe.engine_fields import engines_by_encoding, fields_of

# What a job may name (spec.source.topics, and a name that criteria can read).
MOST_TOPICS = 500
MOST_OUTPUTS = 30
_NAME = re.compile(r"(?:/[A-Za-z0-9_-]+)+")
_LONGEST_NAME = 256
_JOB_NAME = re.compile(r"[a-z]([-a-z0-9]*[a-z0-9])?")
_LONGEST_JOB_NAME = 40
# Lengths of a fragment in seconds, of which the longest is taken that keeps within the bytes.
_LENGTHS = (60, 20, 10, 5, 2, 1)
_FRAGMENT_BYTES = 256 << 20
_HOUR = 3600.0
# What the agent holds of a fragment, stored and unpacked (docs/operations/sizing.md).
_CASE_BYTES = 4 << 30
_STACK_BYTES, _SHARED_BYTES = 1 << 30, 64 << 20
_UNKNOWN_GROWTH, _UNKNOWN_OUTPUT_BYTES = 3.0, 64 << 20
_STEP_BYTES = 256 << 20
_LONGEST_AGE = 60 * 10**9
_LATEST_STAMP = 10**6
_LEAST_AGES = 5
# A busy machine is no fault of the stack: closer bounds are for those who know it.
_LEAST_GAP, _LEAST_LATENCY_MS = 0.25, 100
_MS = 10**6


class ProposalError(ValueError):
    """No job can be proposed; the sentence says what to write."""


@dataclass(frozen=True)
class Asked:
    """What the user says: `bags` are URIs, and an image and a command may be empty."""

    name: str
    bags: list[str]
    inputs: tuple[str, ...] = ()
    outputs: tuple[str, ...] = ()
    image: str = ""
    command: tuple[str, ...] = ()
    mode: str = "realtime"
    # Each a trigger and its answer.
    steps: tuple[tuple[str, str], ...] = ()


@dataclass(frozen=True)
class ProposedCriterion:
    """A criterion as `spec.evaluate` has it, and where its figure is from."""

    criterion: dict[str, Any]
    why: str


@dataclass(frozen=True)
class Memory:
    """Bytes of what the stack's container holds for its one slot."""

    fragment: int
    unpacked: int
    recorded: int
    assumed: list[str]

    @property
    def whole(self) -> int:
        """What to allow, in whole steps."""
        needed = self.fragment + self.unpacked + self.recorded + _STACK_BYTES + _SHARED_BYTES
        return math.ceil(needed / _STEP_BYTES) * _STEP_BYTES


@dataclass(frozen=True)
class Proposal:
    """A job. `topics` is empty where all are played; seconds are whole milliseconds."""

    asked: Asked
    engine: str
    length: float
    warm_up: float
    memory: Memory
    topics: list[str] = field(default_factory=list)
    remap: dict[str, str] = field(default_factory=dict)
    criteria: list[ProposedCriterion] = field(default_factory=list)
    without: list[str] = field(default_factory=list)
    unfit: list[str] = field(default_factory=list)


def fragment_length(recordings: Recordings) -> tuple[float, float]:
    """The length and the warm-up of fragments, in seconds."""
    wanted = [each for each in _LENGTHS if each <= 20 or recordings.longest > _HOUR]
    for length in wanted:
        warm_up = min(2.0, length / 2) if recordings.longest > length else 0.0
        if recordings.peak(length, warm_up) <= _FRAGMENT_BYTES:
            return float(length), warm_up
    return 1.0, 0.5


def propose(asked: Asked, recordings: Recordings) -> Proposal:
    """The job over these recordings. Raises ProposalError."""
    topics = recordings.topics
    engine = engine_of(topics.values())
    if engine is None:
        raise ProposalError(_of_no_ros(topics.values()))
    for each in recordings.looked:
        own = engine_of(each.topics.values())
        if own != engine:
            raise ProposalError(
                f"{each.uri} is for the engine {own or 'of no ROS'}, and others are for {engine}:"
                " write a job for each kind"
            )
    _check_names(asked, topics)
    encoding = fields_of(engine).encoding or ""
    unfit = [name for name, topic in topics.items() if _unfit(topic, encoding)]
    length, warm_up = fragment_length(recordings)
    longest = min(length, recordings.longest)
    criteria, without = _criteria(asked.outputs, recordings, asked.mode, longest)
    return Proposal(
        asked,
        engine,
        length,
        warm_up,
        _memory(asked, recordings, length, warm_up),
        _played(asked, topics, unfit),
        _moved_aside(asked, topics, unfit),
        criteria,
        without,
        unfit,
    )


def _of_no_ros(topics: Iterable[Topic]) -> str:
    published = [topic for topic in topics if topic.messages]
    if not published:
        return "the recordings hold no message: there is nothing to play"
    there = sorted({each or "no known encoding" for t in published for each in t.encodings})
    return (
        f"the recordings hold messages in {', '.join(map(ascii, there[:5]))}, and the engines of"
        f" ROS play {' and '.join(engines_by_encoding())}: a program of any kind reads files by"
        " stack.engine: exec (docs/tasks/another-simulator.md)"
    )


def _unfit(topic: Topic, encoding: str) -> bool:
    """Whether a topic has messages that the engine can't play, or no name that a job can have."""
    if not topic.messages:
        return False
    return topic.encodings != {encoding} or "" in topic.types or not is_name(topic.name)


def is_name(topic: str) -> bool:
    """Whether a job can name a topic, its criteria too."""
    return bool(_NAME.fullmatch(topic)) and len(topic) <= _LONGEST_NAME


def _check_names(asked: Asked, topics: dict[str, Topic]) -> None:
    if not _JOB_NAME.fullmatch(asked.name) or len(asked.name) > _LONGEST_JOB_NAME:
        raise ProposalError(
            f"--name {asked.name!a} is no job's name: write small letters, digits and hyphens,"
            " such as lane-keeping"
        )
    for option, names in (("--input", asked.inputs), ("--output", asked.outputs)):
        for name in names:
            if not is_name(name):
                raise ProposalError(
                    f"{option} {name!a} is no topic's name: begin with a slash, and write"
                    " letters, digits, underscores and hyphens, such as /imu/data"
                )
        if len(set(names)) != len(names):
            raise ProposalError(f"{option} names a topic twice: write it once")
    for name in asked.inputs:
        if name in asked.outputs:
            raise ProposalError(f"{name} is --input and --output: leave one of them out")
        if name not in topics or not topics[name].messages:
            near = difflib.get_close_matches(name, [t for t in topics if topics[t].messages], 3)
            hint = f": did you mean {' or '.join(map(ascii, near))}?" if near else ""
            raise ProposalError(f"--input {name} has no message in the recordings{hint}")
    _check_steps(asked, topics)
    if len(asked.outputs) > MOST_OUTPUTS:
        raise ProposalError(
            f"{len(asked.outputs)} topics are --output, and at most {MOST_OUTPUTS} get criteria:"
            " name those that matter, and add the others to record.topics"
        )


def _check_steps(asked: Asked, topics: dict[str, Topic]) -> None:
    if asked.steps and asked.mode != "lockstep":
        raise ProposalError("--step is for --mode lockstep: write that as well")
    for trigger, answer in asked.steps:
        played = trigger in topics and topics[trigger].messages
        if not played or (asked.inputs and trigger not in asked.inputs):
            raise ProposalError(
                f"--step {ascii(trigger)[1:-1]}={ascii(answer)[1:-1]}: the trigger is none of the"
                " topics that are played, and nothing would be awaited"
            )
        if answer not in asked.outputs:
            raise ProposalError(
                f"--step {trigger}={ascii(answer)[1:-1]}: the answer is no --output, and what is"
                " not recorded is not awaited: write it as --output as well"
            )


def _played(asked: Asked, topics: dict[str, Topic], unfit: list[str]) -> list[str]:
    if asked.inputs:
        if bad := [name for name in asked.inputs if name in unfit]:
            raise ProposalError(
                f"--input {bad[0]} has messages that the engine of the other topics can't play"
                f" (in {', '.join(map(ascii, sorted(topics[bad[0]].encodings)))}): leave it out"
            )
        return list(asked.inputs)
    if not unfit:
        return []
    names = [name for name, topic in topics.items() if topic.messages and name not in unfit]
    names = [name for name in names if name not in asked.outputs]
    if len(names) > MOST_TOPICS:
        raise ProposalError(
            f"{len(unfit)} topics can't be played, such as {unfit[0]!a}, and a job names at"
            f" most {MOST_TOPICS} of the {len(names)} others: name your stack's by --input"
        )
    if not names:
        raise ProposalError("every topic that can be played is an --output: name fewer of them")
    return names


def _moved_aside(asked: Asked, topics: dict[str, Topic], unfit: list[str]) -> dict[str, str]:
    """Where all topics are played, the recorded outputs under names that no node has."""
    if asked.inputs or unfit:
        return {}
    place = "/recorded"
    while any(name.startswith(f"{place}/") for name in topics):
        place += "_"
    moved = [name for name in asked.outputs if name in topics and topics[name].messages]
    return {f"{place}{name}"[:_LONGEST_NAME]: name for name in moved}


def _memory(asked: Asked, recordings: Recordings, length: float, warm_up: float) -> Memory:
    assumed = []
    fragment = recordings.peak(length, warm_up)
    growth = recordings.growth
    if growth is None:
        assumed.append(f"that compressed bytes become {_UNKNOWN_GROWTH:g} times as many")
        growth = _UNKNOWN_GROWTH
    unpacked = math.ceil(fragment * growth)
    topics = recordings.topics
    known = [topics[name] for name in asked.outputs if name in topics]
    sizes = [t.rate * t.bytes_each for t in known if t.rate and t.bytes_each]
    recorded = math.ceil(2 * sum(sizes) * (length + warm_up))
    if not sizes or len(sizes) < len(asked.outputs):
        assumed.append("64 MiB for what no recording shows of the stack's outputs")
        recorded += _UNKNOWN_OUTPUT_BYTES
    if fragment + unpacked > _CASE_BYTES:
        assumed.append(
            "MORE THAN A CASE MAY HOLD (4 GiB): record smaller chunks, or play fewer topics"
        )
    return Memory(fragment, unpacked, recorded, assumed)


def _criteria(
    outputs: Iterable[str], recordings: Recordings, mode: str, length: float
) -> tuple[list[ProposedCriterion], list[str]]:
    found: list[ProposedCriterion] = []
    without: list[str] = []
    topics = recordings.topics
    for number, name in enumerate(outputs):
        label = _label(name, number)
        topic = topics.get(name)
        if topic is None or not topic.messages:
            why = "it is not in the recordings, so no rate is known: write one"
            found.append(_presence(label, name, why))
        elif topic.latched or topic.rate is None:
            why = "it is latched" if topic.latched else "one message: there is no rate"
            found.append(_presence(label, name, why))
        else:
            _of_rates(label, topic, recordings.course(name), found, without)
            _of_gaps(label, name, recordings.course(name), length, found, without)
            if mode == "lockstep":
                without.append(f"{name}: in lock-step no latency is demanded: steps have deadlines")
            else:
                _of_latency(label, topic, found, without)
    return found, without


def _presence(label: str, topic: str, why: str) -> ProposedCriterion:
    return ProposedCriterion(
        {"name": f"{label} is there", "presence": {"topic": topic, "min": 1}}, why
    )


def _of_rates(
    label: str,
    topic: Topic,
    course: Course | None,
    found: list[ProposedCriterion],
    without: list[str],
) -> None:
    rate = topic.rate or 0.0
    if course is None:
        limit = {"topic": topic.name, "min": _floor(rate / 2)}
        why = f"half of the recorded mean, {rate:.3g}: when they came was not read"
        found.append(ProposedCriterion({"name": f"{label} rate", "rate": limit}, why))
        return
    if course.silent:
        without.append(
            f"{topic.name}: {course.silent} of {course.fragments} fragments have no message of it,"
            " so no rate is demanded"
        )
        return
    limit = {"topic": topic.name, "min": _floor(0.8 * course.slowest)}
    why = f"80 % of the slowest of {course.fragments} fragments, {course.slowest:.3g}"
    found.append(ProposedCriterion({"name": f"{label} rate", "rate": limit}, why))


def _of_gaps(
    label: str,
    topic: str,
    course: Course | None,
    length: float,
    found: list[ProposedCriterion],
    without: list[str],
) -> None:
    """`length` is that of the longest fragment in seconds."""
    if course is None or course.silent:
        return
    allowed = max(_LEAST_GAP, 3 * course.longest_gap)
    least = _floor(1 / allowed)
    # No silence within a fragment is longer than that, also of a stack that is silent throughout.
    if least * length <= 1:
        without.append(
            f"{topic}: the longest recorded gap, {course.longest_gap:.3g} s, is no small part of a"
            f" fragment's {length:.3g} s, so no bound on gaps is demanded"
        )
        return
    why = f"no gap longer than {allowed:.3g} s; the longest that was recorded is"
    why += f" {course.longest_gap:.3g} s"
    limit = {"topic": topic, "min": least, "over": "worst"}
    found.append(ProposedCriterion({"name": f"{label} gap", "rate": limit}, why))


def _of_latency(
    label: str, topic: Topic, found: list[ProposedCriterion], without: list[str]
) -> None:
    ages = topic.sample.ages
    if len(ages) < _LEAST_AGES or len(ages) < topic.sample.messages:
        reason = "no header with a stamp was seen" if not ages else "too few stamps were seen"
        without.append(f"{topic.name}: {reason}, so no latency is demanded")
        return
    if min(ages) < -_LATEST_STAMP or max(ages) > _LONGEST_AGE:
        worst = max(ages) if max(ages) > _LONGEST_AGE else min(ages)
        side = "earlier" if worst > 0 else "later"
        without.append(
            f"{topic.name}: a recorded stamp is {abs(worst) / 1e9:.3g} s {side} than its receipt:"
            " the clocks differ, so no latency is demanded"
        )
        return
    recorded = percentile(ages, 0.99)
    most = max(_LEAST_LATENCY_MS, _ceil(2 * recorded / _MS))
    found.append(
        ProposedCriterion(
            {"name": f"{label} latency", "latency": {"topic": topic.name, "max": f"{most}ms"}},
            f"twice the recorded 99th percentile of {len(ages)}, {recorded / _MS:.3g} ms",
        )
    )


def _label(topic: str, number: int) -> str:
    """A name for criteria: of one topic alone, however long it is."""
    name = topic.strip("/").replace("/", ".")
    return name if name[0].isalnum() and len(name) <= 50 else f"output {number + 1}"


def _floor(value: float) -> float:
    """At most the value, of two figures."""
    if value <= 0:
        return 0.0
    step = 10.0 ** (math.floor(math.log10(value)) - 1)
    return float(f"{math.floor(value / step) * step:.6g}")


def _ceil(value: float) -> int:
    """At least the value, of two figures."""
    step = max(1, int(10 ** (math.floor(math.log10(max(1.0, value))) - 1)))
    return math.ceil(value / step) * step
