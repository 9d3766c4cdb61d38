"""`bin_piped` and what it gives: a lazy collection of records that came out of user logic."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, TypeVar

from pyspark import RDD, SparkContext

from bagpipe.binpiped.batches import ByteBatchSerializer
from bagpipe.binpiped.collecting import COLLECT_BYTES, collect
from bagpipe.binpiped.logic import (
    DEFAULT_RECORD_TIMEOUT_SECONDS,
    DEFAULT_TIMEOUT_SECONDS,
    Deadlines,
    user_logic,
)
from bagpipe.binpiped.partition import MOST_RECORD_BYTES, RECORD_BYTES, PartitionRun
from bagpipe.binpiped.planning import (
    Descriptor,
    fragments,
    located,
    pack,
    partitions_for,
    whole_files,
)
from bagpipe.binpiped.record import Record
from bagpipe.binpiped.saving import Manifest, save
from bagpipe.storage import Storage

if TYPE_CHECKING:
    from pyspark.sql import DataFrame, SparkSession


Element = TypeVar("Element")


class BinPipedRDD:
    """Records that user logic makes of binary files; nothing runs before an action asks.

    Each action runs the program again, as every RDD does: `records().persist()` keeps results.
    """

    def __init__(
        self, spark: SparkContext, partitions: Sequence[Sequence[Descriptor]], run: PartitionRun
    ) -> None:
        self.context = spark
        self.partitions = [list(partition) for partition in partitions]
        self._run = run

    def records(self) -> RDD[Record]:
        """RDD of (name, fields, data); an element is at most `max_record_bytes` large."""
        run = self._run
        records = self._planned().mapPartitions(run.records, preservesPartitioning=True)
        return _in_bounded_batches(records)

    def data(self) -> RDD[bytes]:
        """RDD of the records' bytes alone."""
        run = self._run

        def each(descriptors: Iterable[Descriptor]) -> Iterator[bytes]:
            return map(_data, run.records(descriptors))

        return _in_bounded_batches(self._planned().mapPartitions(each, preservesPartitioning=True))

    def collect(self, max_bytes: int = COLLECT_BYTES) -> list[bytes]:
        """All records' bytes on the driver. Raises CollectTooLargeError instead of filling it."""
        return [record.data for record in self.collect_records(max_bytes)]

    def collect_records(self, max_bytes: int = COLLECT_BYTES) -> list[Record]:
        """All records on the driver. Raises CollectTooLargeError instead of filling it."""
        return collect(self.context, self._planned(), self._run, max_bytes)

    def count(self) -> int:
        """How many records come out; their bytes stay on the executors."""
        run = self._run

        def heads(descriptors: Iterable[Descriptor]) -> list[int]:
            return [sum(1 for item in run.stream(descriptors) if not isinstance(item, bytes))]

        return sum(self._planned().mapPartitions(heads).collect())

    def save_as_binary_files(self, uri: str) -> Manifest:
        """One file for each record, of any size, below `uri`; the manifest names those that count.

        Raises StorageError, also where `uri` holds results already.
        """
        return save(self._planned(), self._run, located(uri))

    def to_df(self, spark: "SparkSession") -> "DataFrame":
        """The DataFrame twin: name, size, fields and data of each record."""
        from bagpipe.binpiped.data_frame import to_frame  # noqa: PLC0415  Arrow only where asked

        return to_frame(spark, self.partitions, self._run)

    def _planned(self) -> RDD[Descriptor]:
        placed = self.context.parallelize(self.partitions, max(1, len(self.partitions)))
        return placed.flatMap(_itself, preservesPartitioning=True)


def bin_piped(  # noqa: PLR0913  options of a public function, all by name
    spark: SparkContext,
    uris: str | Sequence[str],
    *,
    command: Sequence[str] | None = None,
    fifo: tuple[str, str] | str | None = None,
    environment: Mapping[str, str] | None = None,
    cwd: str | None = None,
    timeout: float = DEFAULT_TIMEOUT_SECONDS,
    record_timeout: float = DEFAULT_RECORD_TIMEOUT_SECONDS,
    partitions: int | None = None,
    source: str = "files",
    fragment: float = 60.0,
    topics: Sequence[str] = (),
    max_record_bytes: int = RECORD_BYTES,
    volumes: Mapping[str, str] | None = None,
) -> BinPipedRDD:
    """Send files through a program on Spark's executors (docs/reference/binpipe-api.md).

    `uris` are URIs or paths, globs allowed. The program is a `command` (a list, no shell reads
    it) that is started once for each partition, or serves a `fifo`. `timeout` and
    `record_timeout` are seconds. With `source="rosbag"` a record is a fragment of `fragment`
    seconds of a recording's `topics` (empty: all): of a bag, of MCAP, or of a folder of rosbag2.
    Raises StorageError, ValueError or TypeError.
    """
    if not 0 < max_record_bytes <= MOST_RECORD_BYTES:
        raise ValueError(f"max_record_bytes is 1 to {MOST_RECORD_BYTES:,}")
    if partitions is not None and partitions < 1:
        raise ValueError("partitions is at least 1")
    logic = user_logic(command, fifo, environment, cwd)
    storage = Storage(dict(volumes or {}))
    patterns = [uris] if isinstance(uris, str) else list(uris)
    if source == "files":
        descriptors = whole_files(storage, patterns)
    elif source == "rosbag":
        descriptors = fragments(storage, patterns, fragment, topics)
    else:
        raise ValueError(f"source is 'files' or 'rosbag', not {source!r}")
    count = partitions or partitions_for(descriptors, spark.defaultParallelism)
    run = PartitionRun(logic, Deadlines(timeout, record_timeout), storage, max_record_bytes)
    return BinPipedRDD(spark, pack(descriptors, count), run)


def _itself(partition: list[Descriptor]) -> list[Descriptor]:
    return partition


def _data(record: Record) -> bytes:
    return record.data


def _in_bounded_batches(rdd: RDD[Element]) -> RDD[Element]:
    return rdd._reserialize(ByteBatchSerializer())  # noqa: SLF001  the only way to bound a batch
