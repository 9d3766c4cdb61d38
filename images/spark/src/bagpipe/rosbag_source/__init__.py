"""`spark.read.format("rosbag")`: messages of bags as rows, planned without reading a payload.

    spark.dataSource.register(bagpipe.RosbagDataSource)
    spark.read.format("rosbag").option("topics", "/scan").option("decode", "true").load("*.bag")

Not for: cases, which are bagpipe.plan and bagpipe.run, or programs, which are bagpipe.binpiped.
"""

from collections.abc import Iterable, Iterator
from typing import Any

import pyarrow as pa
from pyspark.sql import types
from pyspark.sql.datasource import DataSource, DataSourceReader, InputPartition

from bagpipe.rosbag_source.columns import Decoder
from bagpipe.rosbag_source.messages import Message, messages
from bagpipe.rosbag_source.planning import Options, TopicType, parse_options, plan, topic_type

__all__ = ["RosbagDataSource"]

_BATCH_BYTES, _BATCH_ROWS = 8 << 20, 4096
_LEADING = [
    ("topic", types.StringType(), pa.string()),
    ("time_ns", types.LongType(), pa.int64()),
    ("type", types.StringType(), pa.string()),
    ("md5sum", types.StringType(), pa.string()),
]


class RosbagDataSource(DataSource):
    """Options: path, topics, fragment, start, end, decode, volumes (docs/reference)."""

    @classmethod
    def name(cls) -> str:
        """What `format` takes."""
        return "rosbag"

    def schema(self) -> types.StructType:
        """topic, time_ns, type, md5sum, and data or, decoded, message."""
        options = parse_options(self.options)
        payload = types.StructField("data", types.BinaryType())
        if options.decode:
            decoder = Decoder(topic_type(options, options.storage))
            payload = types.StructField("message", decoder.column.spark)
        leading = [types.StructField(name, spark) for name, spark, _ in _LEADING]
        return types.StructType([*leading, payload])

    def reader(self, schema: types.StructType) -> "RosbagReader":  # noqa: ARG002  the base class's
        """Plans and reads."""
        return RosbagReader(parse_options(self.options))


class RosbagReader(DataSourceReader):
    """One task for each fragment of each bag.

    There is no pushFilters: Spark refuses a source that has it unless the user switches
    spark.sql.python.filterPushdown.enabled on. The options topics, start and end do the same.
    """

    def __init__(self, options: Options) -> None:
        self._options = options

    def partitions(self) -> list[InputPartition]:
        """The fragments, from the bags' tails."""
        fragments = plan(self._options, self._options.storage)
        # Spark asks for one partition at least.
        return [InputPartition(fragment) for fragment in fragments] or [InputPartition(None)]

    def read(self, partition: InputPartition) -> Iterator[pa.RecordBatch]:
        """A fragment's messages in batches of about 8 MiB."""
        if partition.value is None:
            return
        found = messages(partition.value, self._options.storage)
        decoder: Decoder | None = None
        for batch in _batched(found):
            if self._options.decode and decoder is None:
                decoder = Decoder(batch[0].kind)
            yield _rows(batch, decoder)


def _batched(found: Iterable[Message]) -> Iterator[list[Message]]:
    batch: list[Message] = []
    size = 0
    for message in found:
        batch.append(message)
        size += len(message.data)
        if size >= _BATCH_BYTES or len(batch) >= _BATCH_ROWS:
            yield batch
            batch, size = [], 0
    if batch:
        yield batch


def _rows(batch: list[Message], decoder: Decoder | None) -> pa.RecordBatch:
    kinds: list[TopicType] = [message.kind for message in batch]
    leading: list[list[Any]] = [
        [kind.topic for kind in kinds],
        [message.time for message in batch],
        [kind.type for kind in kinds],
        [kind.md5sum for kind in kinds],
    ]
    arrays = [pa.array(v, t) for v, (_, _, t) in zip(leading, _LEADING, strict=True)]
    names = [name for name, _, _ in _LEADING]
    if decoder is None:
        payload = pa.array([message.data for message in batch], pa.binary())
        return pa.RecordBatch.from_arrays([*arrays, payload], [*names, "data"])
    decoded = pa.array([decoder.decode(m.data) for m in batch], decoder.column.arrow)
    return pa.RecordBatch.from_arrays([*arrays, decoded], [*names, "message"])
