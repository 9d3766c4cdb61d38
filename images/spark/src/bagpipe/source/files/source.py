"""Files of any kind, each of them a case."""

import posixpath
from collections.abc import Callable

from bagpipe.plan.case import Case, crossed
from bagpipe.plan.conditions import Crossing
from bagpipe.plan.made import Plan
from bagpipe.source.expanding import expanded
from bagpipe.source.files.planning import file_cases
from bagpipe.source.source import JobSource
from bagpipe.source_spec import Source
from bagpipe.storage import Storage
from bagpipe.wire.frames import MAX_PAYLOAD_BYTES
from bagpipe.wire.session import InputFile


class Files(JobSource):
    """source.files: only a program that judges itself knows what their bytes mean."""

    def plan(self, conditions: Crossing, storage: Storage) -> Plan:
        """A case for each file, under every condition."""
        files, missing = expanded(self.spec.source.uris, storage, "FileMissing")
        return Plan.of(crossed(file_cases(files, storage), conditions), missing)

    def input(self, case: Case, storage: Storage) -> InputFile:
        """The file, streamed: its size does not matter to memory."""
        return InputFile(
            self.file_name(case),
            case.bytes,
            [(0, offset, length) for offset, length in case.ranges],
            lambda: storage.pieces(case.bag, case.ranges, MAX_PAYLOAD_BYTES, case.bag_version),
        )

    def file_name(self, case: Case) -> str:
        """The file's own."""
        return posixpath.basename(case.bag)

    def input_times(self, _case: Case, _storage: Storage) -> Callable[[], list[int]]:
        """A file has no times."""
        return list

    def truth(self, _case: Case, _topics: set[str], _storage: Storage) -> bytes:
        """A file has no topics."""
        return b""

    def alone(self, uri: str) -> Source:
        """One file."""
        return self.spec.source.model_copy(update={"files": [uri]})


SOURCE = Files
