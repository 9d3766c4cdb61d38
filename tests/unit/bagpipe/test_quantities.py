"""Quantities of memory, and the heap that a JVM gets of one."""

import pytest

from bagpipe.quantities import heap_mebibytes, memory_bytes, quantity, size


@pytest.mark.parametrize(
    ("text", "count"),
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
def test_a_quantity_of_memory_is_so_many_bytes(text: str, count: int) -> None:
    assert memory_bytes(text) == count
    assert quantity(text) == count


@pytest.mark.parametrize("text", ["", "Gi", "-1Gi", "1.Gi", "1 Gi", "1m", "1E", "1ki", "0" * 41])
def test_anything_else_is_refused_with_an_example(text: str) -> None:
    with pytest.raises(ValueError, match="is no quantity of memory: write for example 1Gi"):
        memory_bytes(text)


@pytest.mark.parametrize(
    ("memory", "share"),
    [("4Gi", 2048), ("2050Mi", 1025), ("2051Mi", 1025), ("1026Mi", 513), ("1024Mi", 512),
     ("1G", 512), ("1", 512), ("896Mi", 512), ("3000000000", 1430)],
)  # fmt: skip
def test_the_heap_is_half_of_the_memory_in_mebibytes_and_512_at_least(
    memory: str, share: int
) -> None:
    assert heap_mebibytes(memory) == share


@pytest.mark.parametrize(
    ("count", "words"),
    [
        (0, "0 bytes"), (1023, "1023 bytes"), (1024, "1 KiB"), (1536, "1.5 KiB"),
        (10_000, "9.77 KiB"), (101_837, "99.5 KiB"),
        (102_349, "100 KiB"), (102_400, "100 KiB"), (103_424, "101 KiB"),
        (1_048_575, "1024 KiB"), (1_048_576, "1 MiB"), (2_411_725, "2.3 MiB"),
        (1_073_741_823, "1024 MiB"), (1_073_741_824, "1 GiB"), (16_911_433_728, "15.8 GiB"),
        (1_099_511_627_775, "1024 GiB"), (1_099_511_627_776, "1 TiB"),
        (1_125_899_906_842_624, "1024 TiB"),
    ],
)  # fmt: skip
def test_bytes_are_written_for_people(count: int, words: str) -> None:
    assert size(count) == words


@pytest.mark.parametrize(
    ("text", "cores"), [("500m", 0.5), ("2", 2.0), ("1500m", 1.5), ("0.25", 0.25)]
)
def test_processors_are_cores_or_thousandths_of_one(text: str, cores: float) -> None:
    assert quantity(text) == cores


@pytest.mark.parametrize("text", ["", "m", "-1", "1e3", "NaN", "\uff11Gi", "9" * 400, "1Gi\n"])
def test_what_is_no_quantity_is_refused_with_examples(text: str) -> None:
    with pytest.raises(ValueError, match="write for example 500m, 2, 512Mi or 1Gi"):
        quantity(text)
