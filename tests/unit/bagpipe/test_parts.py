"""Pieces of bags as parts of a case: their windows, their places, and why one can't be played."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from bagpipe.encodings import ROS1
from bagpipe.pieces import RecordedTopics, SequencePart
from bagpipe.plan.fragments import Window
from bagpipe.plan.part import Part
from bagpipe.plan.parts import PartError, PartPlanner, version_of
from bagpipe.storage import OpenFile, Storage
from tests.unit.bagpipe.bags import steady, write_bag

SECOND = 1_000_000_000
BAG = "pvc://recordings/a.bag"


@pytest.fixture
def storage(tmp_path: Path) -> Storage:
    """Of a.bag: /scan from second 1 to 5.9, ten a second, and /odom from second 3 on."""
    recorded = [*steady("/scan", 50, SECOND // 10), *steady("/odom", 30, SECOND // 10, 3 * SECOND)]
    recorded.sort(key=lambda message: message.time)
    write_bag(tmp_path / "a.bag", recorded, chunk_bytes=300)
    write_bag(tmp_path / "none.bag", [])
    return Storage({"recordings": str(tmp_path)})


LAST = 5_900_000_000


def sequence(
    storage: Storage, *written: dict[str, Any], topics: list[str] | None = None, warm_up: int = 0
) -> list[Part]:
    pieces = [SequencePart.model_validate({"bag": BAG} | each) for each in written]
    return PartPlanner(storage, ROS1).sequence(pieces, topics or [], warm_up)


def test_the_first_piece_alone_has_a_lead_in_and_only_once(storage: Storage) -> None:
    parts = sequence(
        storage, {"from": "2s", "to": "3s", "times": 2}, {"from": "3s"}, warm_up=SECOND
    )
    assert [(part.window, part.at) for part in parts] == [
        (Window(2 * SECOND, 3 * SECOND, 4 * SECOND), 3 * SECOND),
        (Window(3 * SECOND, 3 * SECOND, 4 * SECOND), 4 * SECOND),
        (Window(4 * SECOND, 4 * SECOND, LAST + 1), 5 * SECOND),
    ]
    assert [part.shift for part in parts] == [0, SECOND, SECOND]
    assert [part.end for part in parts] == [
        4 * SECOND,
        5 * SECOND,
        5 * SECOND + LAST + 1 - 4 * SECOND,
    ]


def test_a_lead_in_begins_no_earlier_than_its_bag(storage: Storage) -> None:
    (part,) = sequence(storage, {"from": "500ms"}, warm_up=SECOND)
    assert part.window == Window(SECOND, 1_500_000_000, LAST + 1)


def test_a_pause_lies_before_each_time_of_its_piece_but_the_very_first(storage: Storage) -> None:
    second = {"to": "1s", "times": 2, "pause": "250ms"}
    parts = sequence(storage, {"to": "1s", "pause": "5s"}, second)
    assert [part.at for part in parts] == [SECOND, 2_250_000_000, 3_500_000_000]


def test_a_part_has_the_bytes_and_messages_of_its_window(storage: Storage) -> None:
    whole, early = sequence(storage, {}, {"to": "1s"})
    assert (whole.messages, whole.topics) == (80, [])
    assert 10 <= early.messages < 40
    read = sum(length for _, length in [*whole.connections, *whole.ranges])
    assert whole.bytes == read > early.bytes
    assert len(whole.connections) == 2
    (one,) = sequence(storage, {}, topics=["/odom"])
    assert one.messages == 30


def test_the_last_message_is_a_piece_and_what_lies_behind_it_is_none(storage: Storage) -> None:
    (last,) = sequence(storage, {"from": "4900ms"})
    assert last.window == Window(LAST, LAST, LAST + 1)
    with pytest.raises(PartError) as refused:
        sequence(storage, {"from": "4901ms"})
    assert refused.value.reason == "NoMatchingTopics"
    assert str(refused.value) == (
        f"{BAG}: the piece from 4901ms on has no message of the topics;"
        " the bag is 4.900 s long and has /odom, /scan"
    )


def test_a_chunk_that_reaches_over_a_piece_is_no_message_in_it(tmp_path: Path) -> None:
    # /scan from second 1 to 5.9, and /odom to second 61, in one chunk.
    recorded = [*steady("/scan", 50, SECOND // 10), *steady("/odom", 61, SECOND)]
    recorded.sort(key=lambda message: message.time)
    write_bag(tmp_path / "a.bag", recorded)
    storage = Storage({"recordings": str(tmp_path)})
    played = {"to": "4s"}
    for silent in ({"from": "30s", "to": "50s"}, {"from": "4901ms"}):
        with pytest.raises(PartError, match="has no message of the topics") as refused:
            sequence(storage, played, silent, topics=["/scan"])
        assert refused.value.reason == "NoMatchingTopics"
    with pytest.raises(PartError, match="has no message of the topics"):
        beside(storage, "/scan", begin="30s")
    both = sequence(storage, played, {"from": "4900ms", "to": "50s"}, topics=["/scan"])
    assert len(both) == 2
    assert len(sequence(storage, played, {"from": "30s"}, topics=["/odom"])) == 2


def test_a_bag_that_is_empty_or_without_the_topics_is_reported(storage: Storage) -> None:
    with pytest.raises(PartError, match=r"none\.bag: the bag holds no messages") as refused:
        sequence(storage, {"bag": "pvc://recordings/none.bag"})
    assert (refused.value.reason, refused.value.bag) == ("BagEmpty", "pvc://recordings/none.bag")
    with pytest.raises(PartError, match="has no message of the topics") as refused:
        sequence(storage, {}, topics=["/camera"])
    assert refused.value.reason == "NoMatchingTopics"


def test_a_missing_bag_is_reported_as_unreadable(storage: Storage) -> None:
    with pytest.raises(PartError) as refused:
        sequence(storage, {"bag": "pvc://recordings/nowhere.bag"})
    assert refused.value.reason == "BagUnreadable"
    assert str(refused.value).startswith("pvc://recordings/nowhere.bag: ")


def beside(storage: Storage, *topics: str, begin: str = "2s", length: int = SECOND) -> list[Part]:
    piece = RecordedTopics.model_validate({"bag": BAG, "from": begin, "topics": list(topics)})
    return PartPlanner(storage, ROS1).beside([piece, piece], 70 * SECOND, length)


def test_pieces_beside_a_drive_begin_with_it_and_last_as_long(storage: Storage) -> None:
    parts = beside(storage, "/scan")
    window = Window(3 * SECOND, 3 * SECOND, 4 * SECOND)
    assert [(part.window, part.at, part.shift) for part in parts] == [
        (window, 70 * SECOND, 67 * SECOND)
    ] * 2
    assert parts[0].topics == ["/scan"]


def test_a_topic_that_is_to_be_played_must_be_in_the_bag(storage: Storage) -> None:
    with pytest.raises(PartError) as refused:
        beside(storage, "/scan", "/imu", "/camera")
    assert (refused.value.reason, refused.value.bag) == ("NoMatchingTopics", BAG)
    assert str(refused.value) == (
        f"{BAG}: the topics /imu, /camera are not in the bag; it has /odom, /scan"
    )


def test_of_many_topics_ten_are_named(storage: Storage, tmp_path: Path) -> None:
    topics = [f"/t{n:02d}" for n in range(12)]
    (tmp_path / "a.bag").unlink()
    write_bag(tmp_path / "a.bag", [each for topic in topics for each in steady(topic, 1, 1)])
    ten = f"has {', '.join(topics[:10])}$"
    with pytest.raises(PartError, match=ten):
        beside(storage, "/scan")
    with pytest.raises(PartError, match=ten):
        sequence(storage, {}, topics=["/scan"])


def test_a_bag_is_opened_once_however_many_pieces_it_has(
    storage: Storage, monkeypatch: pytest.MonkeyPatch
) -> None:
    opened: list[str] = []
    real = Storage.open

    def counted(self: Storage, uri: str) -> OpenFile:
        opened.append(uri)
        return real(self, uri)

    monkeypatch.setattr(Storage, "open", counted)
    assert len(sequence(storage, {"to": "1s", "times": 3}, {"from": "2s"})) == 4
    assert opened == [BAG]


def test_the_mark_of_the_parts_changes_with_any_of_them(storage: Storage) -> None:
    parts = sequence(storage, {"to": "1s"}, {"from": "2s"})
    mark = version_of(parts)
    assert (len(mark), version_of(sequence(storage, {"to": "1s"}, {"from": "2s"}))) == (32, mark)
    first, second = parts
    others = [
        [first],
        [second, first],
        [replace(first, version="another"), second],
        [replace(first, bag="pvc://recordings/b.bag"), second],
        [replace(first, at=first.at + 1), second],
        [first, replace(second, window=Window(0, second.window.start, second.window.end + 1))],
    ]
    assert len({mark, *map(version_of, others)}) == 7
    assert version_of([]) == ""
