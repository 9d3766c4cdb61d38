"""Bags on storage, cut into fragments."""

import posixpath
from collections.abc import Callable
from functools import cache, partial
from pathlib import Path
from typing import TYPE_CHECKING

from bagpipe.engine_fields import fields_of
from bagpipe.plan.bag_tail import read_tail
from bagpipe.plan.case import Case
from bagpipe.plan.conditions import Crossing
from bagpipe.plan.made import Plan
from bagpipe.source.bags.expanding import recordings
from bagpipe.source.bags.folder_stream import (
    folder_file,
    folder_truth,
    times_of_folder,
)
from bagpipe.source.bags.late import late_of
from bagpipe.source.bags.opening import opened
from bagpipe.source.bags.planning import fragments
from bagpipe.source.bags.stream import fragment_file
from bagpipe.source.bags.times import times_in
from bagpipe.source.bags.truth import chunks_with
from bagpipe.source.naming import stem
from bagpipe.source.source import JobSource
from bagpipe.source_spec import Source
from bagpipe.storage import Storage
from bagpipe.wire.session import InputFile

if TYPE_CHECKING:
    from bagpipe.evaluate.evidence import InputStamps


class Bags(JobSource):
    """source.bags: each case is a window of one bag."""

    def plan(self, conditions: Crossing, storage: Storage) -> Plan:
        """The fragments of all bags, under every condition."""
        return self.plan_of(self.spec.source.uris, conditions, storage)

    def plan_of(self, patterns: list[str], conditions: Crossing, storage: Storage) -> Plan:
        """The fragments of the bags that these URIs name."""
        bags, missing = recordings(patterns, storage)
        encoding = fields_of(self.spec.stack.engine).encoding
        made = fragments(
            bags, self.spec.source, encoding, conditions, storage, late_of(self.spec.stack)
        )
        return Plan.of(made.cases, missing + made.unplanned)

    def input(self, case: Case, storage: Storage) -> InputFile:
        """The fragment's chunks as they are stored; of a folder's files, one file of MCAP."""
        if case.parts:
            return folder_file(case, storage, late_of(self.spec.stack))
        return fragment_file(case, storage)

    def file_name(self, case: Case) -> str:
        """The bag's own; that of a folder with the ending of what is made of it."""
        return f"{stem(case.bag)}.mcap" if case.parts else posixpath.basename(case.bag)

    def input_times(self, case: Case, storage: Storage) -> Callable[[], list[int]]:
        """Read from the bag's indexes; of a folder, from the messages themselves."""

        def read() -> list[int]:
            topics, window = self.spec.source.topics, case.window
            if case.parts:
                return times_of_folder(case, topics, storage)
            recording = opened(case.bag, storage)
            return times_in(recording.tail, topics, window.start, window.end, recording.times)

        return read

    def input_stamps(self, case: Case, storage: Storage) -> "InputStamps":
        """Read from the chunks of that time, where these are few."""
        from bagpipe.source.bags.input_stamps import stamps_in  # noqa: PLC0415

        return cache(partial(stamps_in, case, self.spec.source.topics, storage))

    def truth(self, case: Case, topics: set[str], storage: Storage) -> bytes:
        """The chunks that hold one of the topics in the window."""
        if case.parts:
            return folder_truth(case, topics, storage)
        return chunks_with(topics, case, storage)

    def alone(self, uri: str) -> Source:
        """One bag."""
        return self.spec.source.model_copy(update={"bags": [uri]})

    def begin(self, case: Case, storage: Storage, written: Path) -> int:
        """Read from the bag's index; of a folder, from what was made of it."""
        if case.parts:
            return super().begin(case, storage, written)
        file = storage.open(case.bag)
        starts = {offset for offset, _ in case.ranges}
        chunks = read_tail(file.read, file.size).chunks
        return min(chunk.start_time for chunk in chunks if chunk.offset in starts)


SOURCE = Bags
