"""Results to the driver, measured first: what would not fit is refused before it is moved."""

from collections.abc import Iterable, Iterator
from functools import partial
from typing import NamedTuple

from pyspark import RDD, SparkContext, StorageLevel

from bagpipe.binpiped.batches import ByteBatchSerializer
from bagpipe.binpiped.failure import CollectTooLargeError
from bagpipe.binpiped.partition import PartitionRun
from bagpipe.binpiped.planning import Descriptor
from bagpipe.binpiped.record import Record

COLLECT_BYTES = 256 << 20
# A record costs the driver something even where it is empty.
_RECORD_OVERHEAD_BYTES = 64
# Spark holds a job's result several times while it hands it over: stored, fetched, decoded, sent.
# So the driver asks for slices, each by a job that reads the kept partition again.
_HEAP_SHARE = 16
_SLICE_BYTES = 256 << 20
_MOST_SLICES = 16


def weight(record: Record) -> int:
    """What a record counts in a budget: its data, name and fields, and 64 bytes for itself."""
    fields = sum(
        len(key) + (len(value) if isinstance(value, (str, bytes)) else 8)
        for key, value in record.fields.items()
    )
    return len(record.data) + len(record.name) + fields + _RECORD_OVERHEAD_BYTES


def collect(
    spark: SparkContext, planned: RDD[Descriptor], run: PartitionRun, max_bytes: int
) -> list[Record]:
    """All records, after a pass that keeps them on the executors' disks and measures them.

    The program runs once. Of a partition that is above the budget alone, and of a record that is
    larger than a slice, only the sizes are kept. Raises CollectTooLargeError.
    """
    slice_bytes = min(_heap_bytes(spark) // _HEAP_SHARE, _SLICE_BYTES)

    def within_budget(descriptors: Iterable[Descriptor]) -> Iterator[Record | int]:
        held = 0
        for record in run.records(descriptors):
            size = weight(record)
            held += size
            yield record if held <= max_bytes and size <= slice_bytes else size

    kept = planned.mapPartitions(within_budget, preservesPartitioning=True)
    kept = kept._reserialize(ByteBatchSerializer())  # noqa: SLF001  the only way to bound a batch
    kept.persist(StorageLevel.DISK_ONLY)
    try:
        sums: list[_Sum] = kept.mapPartitions(_sum).collect()
        _refuse_above(sums, max_bytes, slice_bytes)
        found: list[Record] = []
        for partition, (size, _) in enumerate(sums):
            for begin in range(0, size, slice_bytes):
                part = partial(_slice, begin=begin, end=begin + slice_bytes)
                found += spark.runJob(kept, part, [partition])
        return found
    finally:
        kept.unpersist()


class _Sum(NamedTuple):
    """What a partition's records weigh together, and the heaviest of them."""

    all: int
    largest: int


def _sum(records: Iterable[Record | int]) -> Iterator[_Sum]:
    together = largest = 0
    for record in records:
        size = record if isinstance(record, int) else weight(record)
        together += size
        largest = max(largest, size)
    yield _Sum(together, largest)


def _slice(records: Iterable[Record | int], begin: int, end: int) -> Iterator[Record]:
    """The records that begin at these bytes of their partition."""
    at = 0
    for record in records:
        if isinstance(record, Record):
            if begin <= at < end:
                yield record
            at += weight(record)


def _refuse_above(sums: list[_Sum], max_bytes: int, slice_bytes: int) -> None:
    actual = sum(one.all for one in sums)
    largest = max((one.all for one in sums), default=0)
    record = max((one.largest for one in sums), default=0)
    instead = "save_as_binary_files(uri) stores them without the driver"
    if actual > max_bytes:
        raise CollectTooLargeError(
            f"the results are {actual:,} bytes, the driver takes {max_bytes:,} (max_bytes=):"
            f" {instead}",
            actual,
            max_bytes,
        )
    if record > slice_bytes:
        memory = "" if record > _SLICE_BYTES else "use a larger spark.driver.memory, or "
        raise CollectTooLargeError(
            f"one record is {record:,} bytes; the driver's JVM holds a record several times while"
            f" it passes it on, and takes {slice_bytes:,} of one (a sixteenth of its heap, at most"
            f" {_SLICE_BYTES:,}): {memory}{instead}",
            record,
            slice_bytes,
        )
    most = slice_bytes * _MOST_SLICES
    if largest > most:
        raise CollectTooLargeError(
            f"one partition's results are {largest:,} bytes; the driver's JVM can pass on"
            f" {most:,} of one partition: use more partitions= or a larger"
            f" spark.driver.memory, or {instead}",
            largest,
            most,
        )


def _heap_bytes(spark: SparkContext) -> int:
    virtual_machine = spark._jvm  # noqa: SLF001  the only way to its heap's size
    if virtual_machine is None:
        return _HEAP_SHARE * _SLICE_BYTES
    return int(virtual_machine.java.lang.Runtime.getRuntime().maxMemory())
