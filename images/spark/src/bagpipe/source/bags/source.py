"""Bags on storage, cut into fragments."""

import posixpath
from collections.abc import Callable
from pathlib import Path

from bagpipe.engine_fields import fields_of
from bagpipe.plan.bag_tail import read_tail
from bagpipe.plan.case import Case
from bagpipe.plan.conditions import Crossing
from bagpipe.plan.made import Plan
from bagpipe.source.bags.planning import fragments
from bagpipe.source.bags.stream import fragment_file
from bagpipe.source.bags.times import times_in
from bagpipe.source.bags.truth import chunks_with
from bagpipe.source.expanding import expanded
from bagpipe.source.source import JobSource
from bagpipe.source_spec import Source
from bagpipe.storage import Storage
from bagpipe.wire.session import InputFile


class Bags(JobSource):
    """source.bags: each case is a window of one bag."""

    def plan(self, conditions: Crossing, storage: Storage) -> Plan:
        """The fragments of all bags, under every condition."""
        bags, missing = expanded(self.spec.source.uris, storage, "BagMissing")
        encoding = fields_of(self.spec.stack.engine).encoding
        made = fragments(bags, self.spec.source, encoding, conditions, storage)
        return Plan.of(made.cases, missing + made.unplanned)

    def input(self, case: Case, storage: Storage) -> InputFile:
        """The fragment's chunks as they are stored."""
        return fragment_file(case, storage)

    def file_name(self, case: Case) -> str:
        """The bag's own."""
        return posixpath.basename(case.bag)

    def input_times(self, case: Case, storage: Storage) -> Callable[[], list[int]]:
        """Read from the bag's indexes."""

        def read() -> list[int]:
            file = storage.open(case.bag)
            tail = read_tail(file.read, file.size)
            window = case.window
            return times_in(tail, self.spec.source.topics, window.start, window.end, file.read)

        return read

    def truth(self, case: Case, topics: set[str], storage: Storage) -> bytes:
        """The chunks that hold one of the topics in the window."""
        return chunks_with(topics, case, storage)

    def alone(self, uri: str) -> Source:
        """One bag."""
        return self.spec.source.model_copy(update={"bags": [uri]})

    def begin(self, case: Case, storage: Storage, _written: Path) -> int:
        """Read from the bag's index."""
        file = storage.open(case.bag)
        starts = {offset for offset, _ in case.ranges}
        chunks = read_tail(file.read, file.size).chunks
        return min(chunk.start_time for chunk in chunks if chunk.offset in starts)


SOURCE = Bags
