"""Recorded topics beside a simulator: what has come due since the moment before."""

import heapq
from collections.abc import Iterator
from typing import Any

from bagpipe.native import native
from bagpipe.plan.case import Case
from bagpipe.simulator.messages import Publication
from bagpipe.source.part_reader import PartMessage, PartReader
from bagpipe.storage import Storage
from bagpipe.topic_names import resolve
from bagpipe.wire.session import SessionError


class RecordedTopics:
    """The parts of a case, played at the same time as its simulator.

    A message is due in the first moment that is not before it. Raises SessionError, also where a
    topic was recorded with two types, and StorageError.
    """

    def __init__(self, case: Case, storage: Storage, encoding: str) -> None:
        readers = [PartReader(part, storage, encoding) for part in case.parts]
        self.publications = _publications([c for each in readers for c in each.connections])
        self._latched = [each for reader in readers for each in reader.latched()]
        by_time = [reader.messages() for reader in readers]
        self._coming: Iterator[PartMessage] = heapq.merge(*by_time, key=lambda each: each.time)
        self._next: PartMessage | None = next(self._coming, None)

    def due(self, time: int) -> list[tuple[str, bytes]]:
        """What is due at `time`, in ns of the case's time: topics and serialised messages."""
        due, self._latched = self._latched, []
        while self._next is not None and self._next.time <= time:
            due.append(self._next)
            self._next = next(self._coming, None)
        return [(resolve(each.connection.topic), each.data) for each in due]


def _publications(connections: list[Any]) -> list[Publication]:
    by_topic: dict[str, list[Any]] = {}
    for each in connections:
        by_topic.setdefault(resolve(each.topic), []).append(each)
    return [_publication(topic, alike) for topic, alike in by_topic.items()]


def _publication(topic: str, connections: list[Any]) -> Publication:
    """As the first connection has it whose definition can be compared with the others'."""
    known = min(connections, key=_rank)
    for each in connections:
        if (different := _different(known, each)) is not None:
            raise SessionError(
                "BagUnreadable",
                f"{topic} was recorded as {different[0]} and as {different[1]}: leave it out of"
                " source.simulator.recorded",
            )
    latching = any(each.latching for each in connections)
    return Publication(topic, known.type, known.md5sum, known.definition, latching)


def _rank(connection: Any) -> int:
    """A definition that is missing, or of IDL, differs from none."""
    if not connection.definition.strip():
        return 2
    return int(connection.schema_encoding == "ros2idl")


def _different(one: Any, other: Any) -> tuple[str, str] | None:
    """How either type of a topic is called, where they are not one. ROS 2 has no MD5 sums, and its
    types' names say nothing of their versions: their definitions are compared.
    """
    if one.type != other.type:
        return one.type, str(other.type)
    what: tuple[str, str] | None = None
    if one.md5sum != other.md5sum:
        what = f"MD5 sum {one.md5sum}", f"MD5 sum {other.md5sum}"
    elif not one.md5sum:
        compare = native("different_field", "comparing types of ROS 2")
        what = compare(one.type, one.definition, other.definition)
    return what and (f"{one.type} with {what[0]}", f"{one.type} with {what[1]}")
