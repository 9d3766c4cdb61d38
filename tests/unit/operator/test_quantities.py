"""Quantities of memory, and the heap that a JVM gets of one."""

import pytest

from bagpipe_operator.api.quantities import heap, memory_bytes


@pytest.mark.parametrize(
    ("quantity", "count"),
    [
        ("0", 0),
        ("1500", 1500),
        ("1k", 1_000),
        ("2M", 2_000_000),
        ("3G", 3_000_000_000),
        ("4T", 4_000_000_000_000),
        ("1Ki", 1024),
        ("1.5Mi", 1_572_864),
        ("2Gi", 2_147_483_648),
        ("1Ti", 1_099_511_627_776),
        ("0" * 39 + "7", 7),
    ],
)
def test_a_quantity_of_memory_is_so_many_bytes(quantity: str, count: int) -> None:
    assert memory_bytes(quantity) == count


@pytest.mark.parametrize("text", ["", "Gi", "-1Gi", "1.Gi", "1 Gi", "1m", "1E", "1ki", "0" * 41])
def test_anything_else_is_refused_with_an_example(text: str) -> None:
    with pytest.raises(ValueError, match="is no quantity of memory: write for example 1Gi"):
        memory_bytes(text)


@pytest.mark.parametrize(
    ("memory", "share"),
    [("4Gi", "2048m"), ("2050Mi", "1025m"), ("2051Mi", "1025m"), ("1026Mi", "513m"),
     ("1024Mi", "512m"), ("1G", "512m"), ("1", "512m")],
)  # fmt: skip
def test_the_heap_is_half_of_the_memory_in_mebibytes_and_512_at_least(
    memory: str, share: str
) -> None:
    assert heap(memory) == share
