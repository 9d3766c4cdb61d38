"""The cases of a job: every fragment of every bag, or the sentence why a bag yields none."""

import posixpath
import re
from collections import Counter
from dataclasses import dataclass

from bagpipe.plan.bag_tail import BagError, BagTail, read_tail
from bagpipe.plan.fragments import Window, cut
from bagpipe.spec import SimulationJobSpec, duration_seconds
from bagpipe.storage import Storage, StorageError


@dataclass(frozen=True)
class Case:
    """One fragment through the stack: all that an executor needs, small enough for the JVM.

    `connections` are (offset, length) ranges of the bag's CONNECTION records, `ranges`
    those of its chunks; both are in bytes of the file `bag`.
    """

    id: str
    bag: str
    window: Window
    connections: list[tuple[int, int]]
    ranges: list[tuple[int, int]]
    messages: int

    @property
    def bytes(self) -> int:
        """Bytes that the case reads from storage."""
        return sum(length for _, length in self.connections + self.ranges)


@dataclass(frozen=True)
class Unplanned:
    """A bag that yields no case, under the name that the results give it."""

    id: str
    bag: str
    reason: str
    message: str


@dataclass(frozen=True)
class Plan:
    """What will run, the biggest case first, and what can't."""

    cases: list[Case]
    unplanned: list[Unplanned]


def plan(spec: SimulationJobSpec, storage: Storage) -> Plan:
    """Read the tail of every bag and cut its fragments; never raises for a bag's fault."""
    bags: list[str] = []
    unplanned: list[Unplanned] = []
    for pattern in spec.source.bags:
        try:
            found = storage.expand(pattern)
        except (StorageError, OSError) as error:
            unplanned.append(_missing(pattern, str(error)))
            continue
        if not found:
            unplanned.append(_missing(pattern, f"no file at {pattern}: check the name and volume"))
        bags += [uri for uri in found if uri not in bags]
    cases: list[Case] = []
    for uri, name in zip(bags, _names(bags), strict=True):
        try:
            cases += _cases_of(uri, name, spec, storage)
        except (BagError, StorageError) as error:
            reason = error.reason if isinstance(error, BagError) else "BagUnreadable"
            unplanned.append(Unplanned(name, uri, reason, f"{uri}: {error}"))
    return Plan(sorted(cases, key=lambda case: (-case.bytes, case.id)), unplanned)


def _missing(pattern: str, message: str) -> Unplanned:
    return Unplanned(_stem(pattern), pattern, "BagMissing", message)


def _cases_of(uri: str, name: str, spec: SimulationJobSpec, storage: Storage) -> list[Case]:
    tail = read_tail(lambda offset, length: storage.read(uri, offset, length), storage.size(uri))
    length = int(duration_seconds(spec.source.fragment.length) * 1e9)
    warm_up = int(duration_seconds(spec.source.fragment.warm_up) * 1e9)
    fragments = cut(tail, spec.source.topics, length, warm_up)
    if not fragments:
        present = ", ".join(sorted({c.topic for c in tail.connections})[:10])
        raise BagError(
            "NoMatchingTopics",
            f"none of the topics {', '.join(spec.source.topics)} is in the bag; it has {present}",
        )
    connections = _connection_ranges(tail)
    return [
        Case(
            id=f"{name}-{number:04d}",
            bag=uri,
            window=fragment.window,
            connections=connections,
            ranges=fragment.ranges,
            messages=fragment.messages,
        )
        for number, fragment in enumerate(fragments)
    ]


def _connection_ranges(tail: BagTail) -> list[tuple[int, int]]:
    return [(connection.offset, connection.length) for connection in tail.connections]


def _names(bags: list[str]) -> list[str]:
    """A readable name per bag, numbered where two bags would share one."""
    stems = [_stem(uri) for uri in bags]
    counts = Counter(stems)
    return [
        stem if counts[stem] == 1 else f"{stem}-{number:03d}" for number, stem in enumerate(stems)
    ]


def _stem(uri: str) -> str:
    base = posixpath.basename(uri).removesuffix(".bag")
    return re.sub(r"[^A-Za-z0-9_.-]+", "-", base).strip("-.") or "bag"
