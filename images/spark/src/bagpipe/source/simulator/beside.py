"""Recorded topics beside a simulator: what has come due since the moment before."""

import heapq
from collections.abc import Iterator
from typing import Any

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
    found: dict[str, Publication] = {}
    for each in connections:
        topic = resolve(each.topic)
        before = found.get(topic)
        if before is not None and (before.type, before.md5sum) != (each.type, each.md5sum):
            raise SessionError(
                "BagUnreadable",
                f"{topic} was recorded as {before.type} and as {each.type}: leave it out of"
                " source.simulator.recorded",
            )
        latching = each.latching or (before is not None and before.latching)
        found[topic] = Publication(topic, each.type, each.md5sum, each.definition, latching)
    return list(found.values())
