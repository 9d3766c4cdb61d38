"""bagpipe.MemoryBag over MCAP: the bag of the same messages."""

from pathlib import Path

import pytest

from bagpipe import BagError, MemoryBag
from tests.mcap_of_bag import COMPRESSIONS, mcap_of
from tests.unit.bagpipe.bags import Recorded, steady, write_bag
from tests.unit.bagpipe.test_mcap_planning import written


@pytest.fixture
def bag(tmp_path: Path) -> Path:
    messages = [*steady("/scan", 50, 10_000_000), Recorded("/map", 1_100_000_005, "m", True)]
    messages.sort(key=lambda message: message.time)
    return write_bag(tmp_path / "two.bag", messages, chunk_bytes=512)


def content(bag: MemoryBag) -> list[tuple[object, ...]]:
    return [
        (c.topic, c.type, c.md5sum, c.definition, c.callerid, c.latching, time, bytes(raw))
        for c, time, raw in bag.messages()
    ]


@pytest.mark.parametrize("compression", sorted(COMPRESSIONS))
def test_it_has_the_same_connections_and_messages(bag: Path, compression: str) -> None:
    path = mcap_of(bag, bag.with_suffix(".mcap"), compression, 512)
    expected = content(MemoryBag.open(bag))
    assert len(expected) == 51
    assert content(MemoryBag.open(path)) == expected
    opened = MemoryBag(path.read_bytes())
    assert content(opened) == expected
    assert opened.damage is None
    assert opened.slice(1_100_000_000, 1_200_000_000, ["/scan"]).message_count == 10


def test_of_a_cut_one_what_is_whole_is_there_and_the_loss_is_reported(bag: Path) -> None:
    data = mcap_of(bag, bag.with_suffix(".mcap"), "none", 512).read_bytes()
    opened = MemoryBag(data[: len(data) // 3])
    expected = content(MemoryBag.open(bag))
    found = content(opened)
    assert 0 < len(found) < len(expected)
    assert found == expected[: len(found)]
    assert opened.damage is not None
    assert opened.damage.offset <= len(data) // 3
    with pytest.raises(BagError, match="the bag is damaged"):
        opened.slice()


def test_messages_of_ros_2_are_no_bag() -> None:
    with pytest.raises(BagError, match="/a has messages in cdr, and a bag holds ROS 1's"):
        MemoryBag(written("cdr"))


def test_its_memory_is_bounded(bag: Path) -> None:
    data = mcap_of(bag, bag.with_suffix(".mcap"), "zstd", 512).read_bytes()
    with pytest.raises(BagError, match="bytes of memory"):
        MemoryBag(data, decompressed_bytes=1000)
