"""bagpipe.MemoryBag where it must hold: lifetimes, threads, damage and budgets."""

import gc
import struct
import threading
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from bagpipe import BagError, MemoryBag
from tests.unit.bagpipe.bags import steady, write_bag

KIND = {"type": "std_msgs/String", "md5sum": "0" * 32, "definition": "string data\n"}
COMPRESSIONS = ["none", "lz4", "bz2"]


def numbered(count: int, compression: str, size: int = 1000) -> MemoryBag:
    """Messages that hold their number again and again."""
    writer = MemoryBag.writer(compression=compression)  # type: ignore[arg-type]
    for number in range(count):
        writer.write("/n", number, struct.pack("<Q", number) * (size // 8), **KIND)  # type: ignore[arg-type]
    return writer.finish()


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> bytes:
    path = tmp_path_factory.mktemp("bags") / "whole.bag"
    return write_bag(path, steady("/t", 200, 1_000_000), chunk_bytes=1024).read_bytes()


@pytest.mark.parametrize("compression", COMPRESSIONS)
def test_a_view_outlives_its_bag(compression: str) -> None:
    bag = MemoryBag(numbered(3000, compression).to_bytes())
    views = [raw for *_, raw in bag.messages()]
    assert {(raw.readonly, raw.nbytes, raw.format) for raw in views} == {(True, 1000, "B")}
    del bag
    gc.collect()
    # Memory that was freed would be used again for these.
    rubbish = [b"\xff" * 3_000_000 for _ in range(4)]
    assert all(raw == struct.pack("<Q", at) * 125 for at, raw in enumerate(views))
    assert len(rubbish) == 4


def test_an_iterator_outlives_its_bag() -> None:
    messages = numbered(100, "lz4").messages()
    gc.collect()
    assert [time for _, time, _ in messages] == list(range(100))
    assert next(messages, None) is None


def test_bytes_are_not_copied() -> None:
    data = numbered(10, "none").to_bytes()
    bag = MemoryBag(data)
    assert bag.to_bytes() is data
    assert bag.view() == data
    with pytest.raises(TypeError):
        bag.view()[0] = 0


@pytest.mark.parametrize("compression", COMPRESSIONS)
def test_threads_share_a_bag_and_a_writer(compression: str) -> None:
    bag = MemoryBag(numbered(2000, compression).to_bytes())
    writer = MemoryBag.writer(compression=compression)  # type: ignore[arg-type]
    together = threading.Barrier(6)

    def work(thread: int) -> int:
        together.wait(timeout=30)
        seen = 0
        for _, time, raw in bag.messages():
            writer.write(f"/of{thread}", time, raw, **KIND)  # type: ignore[arg-type]
            seen += raw[0] == time % 256
        part = bag.slice(500, 1500)
        merged = MemoryBag.merge([part, part])
        return seen + merged.message_count + bag.check().messages

    with ThreadPoolExecutor(6) as pool:
        futures = [pool.submit(work, thread) for thread in range(6)]
        assert [each.result(timeout=120) for each in futures] == [2000 + 2000 + 2000] * 6
    both = writer.finish()
    assert both.message_count == 12_000
    for thread in range(6):
        assert [t for _, t, _ in both.messages([f"/of{thread}"])] == list(range(2000))


def test_a_truncated_bag_keeps_what_is_whole(whole: bytes) -> None:
    bag = MemoryBag(whole[: len(whole) // 2])
    assert bag.damage is not None
    assert 60 < bag.message_count < 140
    assert [time for _, time, _ in bag.messages()] == [
        1_000_000_000 + at * 1_000_000 for at in range(bag.message_count)
    ]
    offset = bag.damage.offset
    assert 0 < offset <= len(whole) // 2
    assert bag.damage.bytes >= 0
    refusal = rf"^byte {offset}: expected .*reindex"
    with pytest.raises(BagError, match=refusal):
        bag.slice()
    with pytest.raises(BagError, match=refusal):
        MemoryBag.merge([bag])
    checked = bag.check()
    assert not checked.sound
    assert checked.damage == bag.damage
    assert checked.messages == bag.message_count
    assert checked.problems[0].startswith("the index is unusable: byte ")


@settings(max_examples=200, deadline=None)
@given(data=st.data())
def test_damage_is_an_error_or_named_and_never_anything_else(
    whole: bytes, data: st.DataObject
) -> None:
    damaged = bytearray(whole)
    for _ in range(data.draw(st.integers(1, 4))):
        damaged[data.draw(st.integers(0, len(damaged) - 1))] = data.draw(st.integers(0, 255))
    try:
        bag = MemoryBag(bytes(damaged))
        read = sum(1 for _ in bag.messages())
    except BagError as error:
        assert "byte " in str(error) or "encrypted" in str(error)
    else:
        assert read <= 200
        assert read == bag.message_count or not bag.check().sound


def test_a_budget_is_kept_and_the_bag_can_be_finished() -> None:
    writer = MemoryBag.writer(byte_budget=50_000)
    with pytest.raises(BagError, match="over its budget of 50000"):
        for number in range(100):
            writer.write("/n", number, bytes(1000), **KIND)  # type: ignore[arg-type]
    count, high_water = writer.message_count, writer.high_water
    assert 40 < count < 50
    bag = writer.finish()
    assert bag.message_count == count
    assert bag.view().nbytes <= high_water <= 50_000
    for used in (writer.finish, lambda: writer.message_count):
        with pytest.raises(BagError, match="the bag is finished"):
            used()
    with pytest.raises(BagError, match="over its budget"):
        bag.slice(byte_budget=10_000)


def test_uncompressing_is_bounded() -> None:
    data = numbered(2000, "lz4").to_bytes()
    bag = MemoryBag(data, decompressed_bytes=1_000_000)
    with pytest.raises(BagError, match=r"^byte \d+: what lies there needs \d+ bytes of memory"):
        bag.messages()
    # A window of one chunk stays below the limit: the others are not touched.
    assert [time for _, time, _ in bag.messages(start=10, end=20)] == list(range(10, 20))


def test_numbers_that_no_bag_can_hold_are_refused(tmp_path: Path) -> None:
    bag = numbered(1, "none")
    for wrong in (-1, 2**64):
        with pytest.raises(OverflowError):
            bag.messages(start=wrong)
    with pytest.raises(IsADirectoryError):
        MemoryBag.open(tmp_path)
