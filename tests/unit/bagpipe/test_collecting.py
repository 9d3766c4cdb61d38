"""What collect moves to the driver, with partitions that are lists instead of Spark's."""

from collections.abc import Callable, Iterable, Iterator
from types import SimpleNamespace
from typing import Any

import pytest

from bagpipe.binpiped.collecting import collect, weight
from bagpipe.binpiped.failure import CollectTooLargeError
from bagpipe.binpiped.record import Record

HEAP_BYTES = 16_000
SLICE_BYTES = 1_000

Partitions = list[list[Any]]


class Lists:
    """As much of an RDD as collect asks for; `made` are the partitions that it was made into."""

    def __init__(self, partitions: Partitions) -> None:
        self.partitions = partitions
        self.made: list[Lists] = []

    def mapPartitions(  # noqa: N802  Spark's name
        self, each: Callable[[Iterable[Any]], Iterable[Any]], **_options: Any
    ) -> "Lists":
        self.made.append(Lists([list(each(iter(one))) for one in self.partitions]))
        return self.made[-1]

    def _reserialize(self, _serializer: Any) -> "Lists":
        return self

    def persist(self, _level: Any) -> None:
        """Lists stay."""

    def unpersist(self) -> None:
        """Lists stay."""

    def collect(self) -> list[Any]:
        return [element for one in self.partitions for element in one]


class Spark:
    """Reports its heap, and notes the bytes of each job's results."""

    def __init__(self) -> None:
        runtime = SimpleNamespace(maxMemory=lambda: HEAP_BYTES)
        lang = SimpleNamespace(Runtime=SimpleNamespace(getRuntime=lambda: runtime))
        self._jvm = SimpleNamespace(java=SimpleNamespace(lang=lang))
        self.moved: list[int] = []

    def runJob(  # noqa: N802  Spark's name
        self, rdd: Lists, each: Callable[[Iterable[Any]], Iterable[Any]], partitions: list[int]
    ) -> list[Any]:
        found = [element for n in partitions for element in each(iter(rdd.partitions[n]))]
        self.moved.append(sum(map(weight, found)))
        return found


class Run:
    """A program that gives records of the sizes that it is given."""

    def records(self, sizes: Iterable[int]) -> Iterator[Record]:
        return (Record("r", {}, bytes(size)) for size in sizes)


def collected(spark: Spark, planned: Lists, max_bytes: int) -> list[int]:
    """The sizes of the records that came."""
    unchecked: Any = collect
    return [len(record.data) for record in unchecked(spark, planned, Run(), max_bytes)]


def test_what_fits_comes_in_slices_of_the_heap() -> None:
    spark = Spark()
    found = collected(spark, Lists([[300] * 20, [], [900]]), 20_000)
    assert found == [300] * 20 + [900]
    assert max(spark.moved) < 2 * SLICE_BYTES


@pytest.mark.parametrize("sizes", [[[1_000]], [[10, 5_000, 10], [7]]])
def test_a_record_above_a_slice_is_refused_and_never_kept(sizes: Partitions) -> None:
    spark, planned = Spark(), Lists(sizes)
    with pytest.raises(CollectTooLargeError, match=r"larger spark\.driver\.memory, or") as refused:
        collected(spark, planned, 1 << 30)
    largest = max(size for one in sizes for size in one)
    assert refused.value.actual == largest + len("r") + 64
    assert refused.value.limit == SLICE_BYTES
    kept = planned.made[0].collect()
    assert refused.value.actual in kept
    assert all(weight(one) <= SLICE_BYTES for one in kept if isinstance(one, Record))
    assert spark.moved == []


def test_more_than_the_budget_is_refused_first() -> None:
    with pytest.raises(CollectTooLargeError, match=r"the driver takes 2,000 \(max_bytes=\)"):
        collected(Spark(), Lists([[5_000]]), 2_000)


def test_a_partition_of_too_many_slices_is_refused() -> None:
    with pytest.raises(CollectTooLargeError, match="use more partitions="):
        collected(Spark(), Lists([[100] * 200]), 1 << 30)
