"""Pieces of recordings, one after the other, as one case."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import bagpipe
from bagpipe.judgement import Judgement
from bagpipe.pipe.session import InputFile
from bagpipe.plan.case import Case
from bagpipe.plan.conditions import Crossing
from bagpipe.plan.made import Plan
from bagpipe.source.sequence.planning import sequences
from bagpipe.source.sequence.stream import sequence_bag, sequence_file
from bagpipe.spec import Source
from bagpipe.storage import Storage


@dataclass(frozen=True)
class Sequence:
    """source.sequence: one case, put together before it is played."""

    spec: Source

    def plan(self, conditions: Crossing, storage: Storage) -> Plan:
        """The sequence under every condition."""
        return sequences(self.spec, conditions, storage)

    def input(self, case: Case, storage: Storage) -> InputFile:
        """The whole sequence as a bag."""
        return sequence_file(case, storage, case.bag)

    def file_name(self, case: Case) -> str:
        """A bag's name."""
        return f"{case.bag}.bag"

    def input_times(self, case: Case, storage: Storage) -> Callable[[], list[int]]:
        """Told by the sequence itself."""

        def read() -> list[int]:
            bag = sequence_bag(case, storage)
            topics = self.spec.topics
            there = [topic for topic in bag.topics if not topics or topic in topics]
            window = bag.messages(topics=there, start=case.window.start, end=case.window.end)
            return [time for _, time, _ in window]

        return read

    def truth(self, case: Case, _topics: set[str], storage: Storage) -> bytes:
        """The sequence whole."""
        return sequence_bag(case, storage).to_bytes()

    def judge(self, _result: dict[str, Any], judgement: Judgement) -> Judgement:
        """Nothing to add."""
        return judgement

    def alone(self, _uri: str) -> Source:
        """A sequence needs all of its recordings."""
        return self.spec

    def begin(self, _case: Case, _storage: Storage, written: Path) -> int:
        """Told by what was written."""
        return bagpipe.MemoryBag.open(written).start or 0
