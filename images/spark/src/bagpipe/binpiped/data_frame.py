"""The DataFrame twin of BinPipedRDD: the same stream, as Arrow batches of bounded bytes."""

from collections.abc import Iterator, Sequence

import pyarrow as pa
from pyspark.sql import DataFrame, SparkSession
from pyspark.sql.datasource import DataSource, DataSourceReader, InputPartition
from pyspark.sql.types import (
    BinaryType,
    LongType,
    MapType,
    StringType,
    StructField,
    StructType,
)

from bagpipe.binpiped.batches import batched
from bagpipe.binpiped.partition import PartitionRun
from bagpipe.binpiped.planning import Descriptor
from bagpipe.binpiped.record import Record

# A column has one type, so a record's fields are three maps.
SCHEMA = StructType(
    [
        StructField("name", StringType(), nullable=False),
        StructField("size", LongType(), nullable=False),
        StructField(
            "fields",
            StructType(
                [
                    StructField("strings", MapType(StringType(), StringType())),
                    StructField("integers", MapType(StringType(), LongType())),
                    StructField("bytes", MapType(StringType(), BinaryType())),
                ]
            ),
        ),
        StructField("data", BinaryType(), nullable=False),
    ]
)
_ARROW = pa.schema(
    [
        pa.field("name", pa.string(), nullable=False),
        pa.field("size", pa.int64(), nullable=False),
        pa.field(
            "fields",
            pa.struct(
                [
                    ("strings", pa.map_(pa.string(), pa.string())),
                    ("integers", pa.map_(pa.string(), pa.int64())),
                    ("bytes", pa.map_(pa.string(), pa.binary())),
                ]
            ),
        ),
        pa.field("data", pa.binary(), nullable=False),
    ]
)


class _Reader(DataSourceReader):
    """Runs the program in each task."""

    def __init__(self, partitions: Sequence[Sequence[Descriptor]], run: PartitionRun) -> None:
        self._partitions = partitions
        self._run = run

    def partitions(self) -> list[InputPartition]:
        return [InputPartition(partition) for partition in self._partitions]

    def read(self, partition: InputPartition) -> Iterator[pa.RecordBatch]:
        for records in batched(self._run.records(partition.value)):
            yield _batch(records)


def to_frame(
    spark: SparkSession, partitions: Sequence[Sequence[Descriptor]], run: PartitionRun
) -> DataFrame:
    """A lazy frame with one task for each partition; columns as in SCHEMA."""

    # A data source of its own: mapInArrow would ask for pandas, and a source takes no objects.
    class BinPipedDataSource(DataSource):
        @classmethod
        def name(cls) -> str:
            return "binpiped"

        def schema(self) -> StructType:
            return SCHEMA

        def reader(self, schema: StructType) -> _Reader:  # noqa: ARG002  the base class's
            return _Reader(partitions, run)

    spark.dataSource.register(BinPipedDataSource)
    return spark.read.format("binpiped").load()


def _batch(records: list[Record]) -> pa.RecordBatch:
    return pa.RecordBatch.from_pylist([_row(record) for record in records], schema=_ARROW)


def _row(record: Record) -> dict[str, object]:
    return {
        "name": record.name,
        "size": len(record.data),
        "fields": {
            column: [(key, value) for key, value in record.fields.items() if type(value) is kind]
            for column, kind in (("strings", str), ("integers", int), ("bytes", bytes))
        },
        "data": record.data,
    }
