"""The cases of a job: every fragment of every bag, as often as it is to be played.

A bag that yields none has a sentence that says why.
"""

import dataclasses
import posixpath
import re
from collections import Counter

from bagpipe.plan.bag_tail import BagError, BagTail, read_tail
from bagpipe.plan.case import Case
from bagpipe.plan.conditions import Crossing, crossing
from bagpipe.plan.files import file_cases
from bagpipe.plan.fragments import cut, holding
from bagpipe.plan.made import Plan, Unplanned
from bagpipe.plan.put_together import drives, sequences
from bagpipe.plan.simulated import check_scenarios
from bagpipe.plan.variant import check_templates
from bagpipe.spec import SimulationJobSpec
from bagpipe.storage import Storage, StorageError
from bagpipe.texts import duration_seconds

__all__ = ["Case", "Plan", "Unplanned", "plan"]


def plan(spec: SimulationJobSpec, storage: Storage) -> Plan:
    """Read the tail of every bag, cut its fragments, and cross them with matrix and variants.

    Never raises for a bag's fault; raises MatrixError for the matrix' and the variants' own.
    """
    conditions = crossing(spec)
    check_templates(spec, conditions)
    if spec.source.simulator is not None:
        check_scenarios(spec)
        return drives(spec.source.simulator, conditions, storage)
    if spec.source.sequence:
        return sequences(spec.source, conditions, storage)
    bags: list[str] = []
    unplanned: list[Unplanned] = []
    for pattern in spec.source.uris:
        try:
            found = storage.expand(pattern)
        except (StorageError, OSError) as error:
            unplanned.append(_missing(pattern, spec, str(error)))
            continue
        if not found:
            message = f"no file at {pattern}: check the name and volume"
            unplanned.append(_missing(pattern, spec, message))
        bags += [uri for uri in found if uri not in bags]
    if spec.source.files:
        return Plan.of(_crossed(file_cases(bags, storage), conditions), unplanned)
    cases: list[Case] = []
    for uri, name in zip(bags, _names(bags), strict=True):
        try:
            cases += _crossed(_fragments_of(uri, name, spec, storage), conditions)
        except (BagError, StorageError) as error:
            reason = error.reason if isinstance(error, BagError) else "BagUnreadable"
            unplanned.append(Unplanned(name, uri, reason, f"{uri}: {error}"))
    return Plan.of(cases, unplanned)


def _missing(pattern: str, spec: SimulationJobSpec, message: str) -> Unplanned:
    reason = "FileMissing" if spec.source.files else "BagMissing"
    return Unplanned(_stem(pattern), pattern, reason, message)


def _crossed(fragments: list[Case], conditions: Crossing) -> list[Case]:
    return [
        dataclasses.replace(case, id=case.id + suffix, fragment=case.id, conditions=condition)
        for case in fragments
        for suffix, condition in conditions.named
    ]


def _fragments_of(uri: str, name: str, spec: SimulationJobSpec, storage: Storage) -> list[Case]:
    file = storage.open(uri)
    tail = read_tail(file.read, file.size)
    length = int(duration_seconds(spec.source.fragment.length) * 1e9)
    warm_up = int(duration_seconds(spec.source.fragment.warm_up) * 1e9)
    fragments = cut(tail, spec.source.topics, length, warm_up, file.read)
    if not fragments:
        raise BagError("NoMatchingTopics", _without_messages(tail, spec.source.topics))
    connections = _connection_ranges(tail)
    return [
        Case(
            id=f"{name}-{fragment.number:04d}",
            bag=uri,
            bag_version=file.version,
            window=fragment.window,
            connections=connections,
            ranges=fragment.ranges,
            messages=fragment.messages,
        )
        for fragment in fragments
    ]


def _without_messages(tail: BagTail, topics: list[str]) -> str:
    """A publisher is in the bag's index even if it never said anything."""
    named = {connection.id: connection.topic for connection in tail.connections}
    said = {named.get(each, "") for chunk in tail.chunks for each in holding(chunk)} - {""}
    what = f"none of the topics {', '.join(topics)} is in the bag"
    if silent := [topic for topic in topics if topic in named.values()]:
        what = f"{', '.join(silent)} is in the bag without a message"
    return f"{what}; it has {', '.join(sorted(said)[:10])}"


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
