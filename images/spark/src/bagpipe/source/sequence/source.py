"""Pieces of recordings, one after the other, as one case."""

from collections.abc import Callable

from bagpipe.encodings import ROS1
from bagpipe.plan.case import Case
from bagpipe.plan.conditions import Crossing
from bagpipe.plan.made import Plan
from bagpipe.source.sequence.planning import sequences
from bagpipe.source.source import JobSource
from bagpipe.source_spec import Source
from bagpipe.storage import Storage
from bagpipe.topic_names import resolve
from bagpipe.wire.session import InputFile


class Sequence(JobSource):
    """source.sequence: one case, put together before it is played."""

    def plan(self, conditions: Crossing, storage: Storage) -> Plan:
        """The sequence under every condition."""
        return sequences(self.spec.source, self.encoding, conditions, storage)

    def input(self, case: Case, storage: Storage) -> InputFile:
        """The whole sequence as one file."""
        from bagpipe.source.sequence.stream import sequence_file  # noqa: PLC0415

        return sequence_file(case, storage, case.bag, self.encoding)

    def file_name(self, case: Case) -> str:
        """A bag's name, or that of MCAP."""
        return f"{case.bag}.{'bag' if self.encoding == ROS1 else 'mcap'}"

    def input_times(self, case: Case, storage: Storage) -> Callable[[], list[int]]:
        """Taken from the sequence itself."""

        from bagpipe.source.part_reader import in_memory  # noqa: PLC0415

        def read() -> list[int]:
            made = self._made(case, storage)
            bag = in_memory(made, self.encoding)
            topics = self.spec.source.topics
            there = [topic for topic in bag.topics if not topics or resolve(topic) in topics]
            window = bag.messages(topics=there, start=case.window.start, end=case.window.end)
            return [time for _, time, _ in window]

        return read

    def truth(self, case: Case, _topics: set[str], storage: Storage) -> bytes:
        """The sequence whole."""
        return bytes(self._made(case, storage))

    def alone(self, _uri: str) -> Source:
        """A sequence needs all of its recordings."""
        return self.spec.source

    def _made(self, case: Case, storage: Storage) -> memoryview:
        from bagpipe.source.sequence.stream import sequence  # noqa: PLC0415

        return sequence(case, storage, self.encoding)


SOURCE = Sequence
