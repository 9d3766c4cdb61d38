"""Records to the JVM in batches of bounded bytes.

Spark's own batches have a number of elements that grows while they are small: a thousand small
records followed by large ones would be held all at once.
"""

import itertools
import struct
from collections.abc import Iterable, Iterator
from typing import Any, BinaryIO

from pyspark.serializers import CPickleSerializer, Serializer

from bagpipe.binpiped.record import Record

BATCH_BYTES, BATCH_RECORDS = 1 << 20, 1024


class ByteBatchSerializer(Serializer):
    """Pickled lists of elements, as Spark's PickleSerializer reads them, of about 1 MiB."""

    def __init__(self) -> None:
        self.serializer = CPickleSerializer()

    def dump_stream(self, iterator: Iterable[Any], stream: BinaryIO) -> None:
        """Write all elements."""
        for batch in batched(iterator):
            data = self.serializer.dumps(batch)  # type: ignore[no-untyped-call]
            stream.write(struct.pack("!i", len(data)))
            stream.write(data)

    def load_stream(self, stream: BinaryIO) -> Iterator[Any]:
        """Read all elements."""
        return itertools.chain.from_iterable(self._load_stream_without_unbatching(stream))

    def _load_stream_without_unbatching(self, stream: BinaryIO) -> Iterator[Any]:
        return iter(self.serializer.load_stream(stream))  # type: ignore[no-untyped-call]

    def __eq__(self, other: object) -> bool:
        return isinstance(other, ByteBatchSerializer)

    def __hash__(self) -> int:
        return hash(ByteBatchSerializer)


def batched(elements: Iterable[Any], least_bytes: int = BATCH_BYTES) -> Iterator[list[Any]]:
    """Lists that end with the element that reaches `least_bytes`, or at 1,024 elements."""
    batch: list[Any] = []
    size = 0
    for element in elements:
        batch.append(element)
        size += _bytes(element)
        if size >= least_bytes or len(batch) >= BATCH_RECORDS:
            yield batch
            batch, size = [], 0
    if batch:
        yield batch


def _bytes(element: Any) -> int:
    data = element.data if isinstance(element, Record) else element
    return len(data) if isinstance(data, (bytes, bytearray)) else 64
