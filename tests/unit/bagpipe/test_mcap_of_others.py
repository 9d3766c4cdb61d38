"""MCAP of unusual writers: planned as its messages are, or refused, and never a message less."""

import struct
from pathlib import Path

import pytest

from bagpipe import BagError as NoBagError
from bagpipe import MemoryBag
from bagpipe.cli.bag_reading import BagFile
from bagpipe.encodings import ROS1
from bagpipe.evaluate.evidence import Recording
from bagpipe.pieces import SequencePart
from bagpipe.plan.bag_tail import BagError
from bagpipe.plan.fragments import cut
from bagpipe.plan.parts import PartPlanner
from bagpipe.source.bags.truth import chunks_with
from bagpipe.source.part_reader import PartReader
from bagpipe.source.planning import plan
from bagpipe.storage import Storage
from tests.unit.bagpipe.bags import steady, write_bag
from tests.unit.bagpipe.mcap_records import (
    SCHEMA,
    Times,
    channel,
    chunk,
    mcap,
    message,
    record,
    text,
)
from tests.unit.bagpipe.test_mcap_planning import spec_over, tail_of

SECOND = 1_000_000_000
START = 1_700_000_000 * SECOND
A, JSON = channel(1, "/a"), channel(2, "/j", "json")


def two_seconds(encoding: str = "ros1") -> bytes:
    """A message of /a a second, the last at second 2."""
    chunks: list[dict[int, Times]] = [{1: [START + at * SECOND]} for at in range(3)]
    return mcap(chunks, [channel(1, "/a", encoding)], before=SCHEMA + A)


def with_json(silent: bool) -> bytes:
    times = {1: [START]} if silent else {1: [START], 2: [START]}
    return mcap([times], [A, JSON], before=SCHEMA + A + JSON)


@pytest.fixture
def storage(tmp_path: Path) -> Storage:
    return Storage({"drives": str(tmp_path)})


def test_a_chunk_without_a_message_does_not_begin_the_recording(
    tmp_path: Path, storage: Storage
) -> None:
    """Writers in C++ give a chunk of declarations alone the times 0."""
    path = tmp_path / "a.mcap"
    path.write_bytes(mcap([{}, {1: [START, START + 2 * SECOND]}], [A], before=SCHEMA + A))
    assert BagFile(f"file://{path}", storage, 1 << 20).described()["seconds"] == 2.0
    piece = SequencePart.model_validate({"bag": "pvc://drives/a.mcap", "from": "1s"})
    (part,) = PartPlanner(storage, ROS1).sequence([piece], [], 0)
    assert (part.window.start, part.messages) == (START + SECOND, 2)


@pytest.mark.parametrize(
    "behind",
    [message(1, START + SECOND), b"".join(chunk({1: [START + SECOND]})[:2])],
    ids=["a-message-outside-of-chunks", "a-chunk-that-no-index-names"],
)
def test_without_statistics_no_message_may_lie_elsewhere(behind: bytes) -> None:
    for statistics in (True, False):
        data = mcap([{1: [START]}], [A], behind, statistics=statistics, before=SCHEMA + A)
        if statistics:  # which count what the indexes name, and so lie
            assert len(tail_of(data).chunks) == 1
            continue
        with pytest.raises(BagError, match="names the places of 1 messages, and not of all") as no:
            tail_of(data)
        assert no.value.reason == "BagNotIndexed"


def test_without_statistics_metadata_may_lie_between_where_the_summary_names_it() -> None:
    behind = record(12, text(b"rosbag2") + text(b""))
    data = mcap([{1: [START]}], [A], behind, statistics=False, before=SCHEMA + A)
    with pytest.raises(BagError, match="and not of all"):
        tail_of(data)
    place = struct.pack("<QQ", data.index(behind), len(behind))
    named = record(13, place + text(b"rosbag2"))
    data = mcap([{1: [START]}], [A, named], behind, statistics=False, before=SCHEMA + A)
    assert len(tail_of(data).chunks) == 1


def test_declarations_are_read_at_once_in_whatever_order_they_lie() -> None:
    """Each range of bytes is a request to storage, and a part of each case."""
    numbers = [1 + at * 7 % 501 for at in range(501)]
    channels = [channel(number, f"/t{number}") for number in numbers]
    tail = tail_of(mcap([{7: [START]}], channels, before=SCHEMA + channel(7, "/t7")))
    assert [length for _, length in tail.declarations[1:]] == [
        len(SCHEMA) + sum(len(each) for each in channels)
    ]
    assert len(tail.connections) == 501


def test_messages_without_a_schema_are_refused_before_a_master_refuses_their_topic(
    tmp_path: Path, storage: Storage
) -> None:
    untyped = channel(1, "/a", schema=0)
    data = mcap([{1: [START], 2: [START]}], [untyped, channel(2, "/b")], before=SCHEMA)
    (tmp_path / "a.mcap").write_bytes(data)
    (unplanned,) = plan(spec_over("a.mcap", "ros1"), storage).unplanned
    assert unplanned.reason == "BagUnreadable"
    assert "/a has messages of no type" in unplanned.message
    assert len(plan(spec_over("a.mcap", "ros1", topics=["/b"]), storage).cases) == 1
    assert len(plan(spec_over("a.mcap", "exec"), storage).cases) == 1


@pytest.mark.parametrize("silent", [True, False], ids=["silent", "with-messages"])
def test_other_encodings_beside_the_topics_are_no_hindrance_after_planning(
    silent: bool, tmp_path: Path, storage: Storage
) -> None:
    """Planning advises to leave such a topic out: the rest must then be readable everywhere."""
    (tmp_path / "a.mcap").write_bytes(with_json(silent))
    spec = spec_over("a.mcap", "ros1", topics=["/a"])
    (case,) = plan(spec, storage).cases
    window = case.window
    truth = Recording(lambda: chunks_with({"/a"}, case, storage), window.start, window.end)
    assert truth.times("/a") == [START]
    piece = SequencePart.model_validate({"bag": "pvc://drives/a.mcap"})
    (part,) = PartPlanner(storage, ROS1).sequence([piece], ["/a"], 0)
    assert [found.time for found in PartReader(part, storage, ROS1).messages()] == [START]
    file = BagFile("pvc://drives/a.mcap", storage, 1 << 20)
    assert file.part(0, None, ("/a",), "none").message_count == 1


def test_a_silent_connection_of_another_encoding_is_left_out_of_the_bag() -> None:
    assert MemoryBag(with_json(silent=True)).topics == ["/a"]
    with pytest.raises(NoBagError, match="/j has messages in json, and a bag holds ROS 1's"):
        MemoryBag(with_json(silent=False))
    assert MemoryBag(with_json(silent=False), mcap_topics=["/a"]).message_count == 1
    with pytest.raises(NoBagError, match="/j has messages in json"):
        MemoryBag(with_json(silent=False), mcap_topics=["/j"])


@pytest.mark.parametrize("time", [(1 << 32) * SECOND, (1 << 64) - 1])
def test_a_time_that_no_bag_can_state_is_refused(time: int) -> None:
    last = (1 << 32) * SECOND - 1
    assert MemoryBag(mcap([{1: [START, last]}], [A], before=SCHEMA + A)).end == last
    with pytest.raises(NoBagError, match=f"logged at {time} ns, and a bag's time ends in 2106"):
        MemoryBag(mcap([{1: [START, time]}], [A], before=SCHEMA + A))


@pytest.mark.parametrize("times", [[0, START], [START, (1 << 64) - 1]])
def test_one_wrong_time_is_refused_before_it_makes_millions_of_windows(times: Times) -> None:
    tail = tail_of(mcap([{1: times}], [A], before=SCHEMA + A))
    with pytest.raises(BagError, match="1,000,000 fragments of 60 s: a time among them is wrong"):
        cut(tail, [], 60 * SECOND, 0)
    assert len(cut(tail, [], 1 << 64, 0)) == 1


def test_recordings_of_one_name_are_kept_apart_whatever_their_formats(
    tmp_path: Path, storage: Storage
) -> None:
    write_bag(tmp_path / "a.bag", steady("/a", 10, SECOND))
    (tmp_path / "a.mcap").write_bytes(two_seconds())
    alone = {case.id for case in plan(spec_over("a.bag", "exec"), storage).cases}
    assert alone == {"a-0000"}
    both = plan(spec_over("*", "exec"), storage).cases
    assert len({case.id for case in both} - alone) == len(both) == 2
