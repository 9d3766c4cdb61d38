"""What a task does with its descriptors; runs in Spark's Python workers."""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass

from bagpipe.binpiped.exchange import exchange
from bagpipe.binpiped.failure import BinPipedError
from bagpipe.binpiped.logic import Deadlines, Logic
from bagpipe.binpiped.planning import Descriptor
from bagpipe.binpiped.record import OutputHead, Record
from bagpipe.storage import Storage

# An RDD's element passes through Python, Spark's pickled rows and a JVM's heap, whole each time.
RECORD_BYTES = 64 << 20
# Above it the JVM has no array for the element.
MOST_RECORD_BYTES = (1 << 31) - (1 << 20)


@dataclass(frozen=True)
class PartitionRun:
    """The settings that every task of a job shares."""

    logic: Logic
    deadlines: Deadlines
    storage: Storage
    record_bytes: int = RECORD_BYTES

    def stream(self, descriptors: Iterable[Descriptor]) -> Iterator[OutputHead | bytes]:
        """The output records, piece by piece: never whole in memory."""
        inputs = (descriptor.open(self.storage) for descriptor in descriptors)
        return exchange(self.logic, inputs, self.deadlines)

    def records(self, descriptors: Iterable[Descriptor]) -> Iterator[Record]:
        """The output records, whole; holds one at a time. Raises BinPipedError."""
        head: OutputHead | None = None
        pieces: list[bytes] = []
        held = 0
        for item in self.stream(descriptors):
            if isinstance(item, bytes):
                held += len(item)
                pieces.append(item)
            else:
                if head is not None:
                    yield Record(head.name, head.fields, _joined(pieces))
                head, pieces, held = item, [], item.size or 0
            if held > self.record_bytes and head is not None:
                raise _too_large(head, self.record_bytes)
            if isinstance(item, OutputHead):
                held = 0
        if head is not None:
            yield Record(head.name, head.fields, _joined(pieces))


def _joined(pieces: list[bytes]) -> bytes:
    return pieces[0] if len(pieces) == 1 else b"".join(pieces)


def _too_large(head: OutputHead, limit: int) -> BinPipedError:
    size = "more" if head.size is None else f"{head.size:,} bytes"
    return BinPipedError(
        "RecordTooLarge",
        f"the output record {head.name} has {size}; an RDD's element may have {limit:,}"
        " (max_record_bytes=), as it passes through the JVM's heap whole: use"
        " save_as_binary_files(uri), which streams records of any size to storage",
    )
