"""The rosbag data source over MCAP and folders of rosbag2: the rows that a bag would have."""

from pathlib import Path
from typing import Any

import pytest
from rosbags.typesys import Stores, get_typestore

from bagpipe.plan.bag_tail import BagTail
from bagpipe.plan.fragments import FragmentPlan, Window, cut_one
from bagpipe.rosbag_source import RosbagReader, planning
from bagpipe.rosbag_source.columns import Decoder
from bagpipe.rosbag_source.messages import messages
from bagpipe.rosbag_source.planning import TopicType, parse_options, plan, topic_type
from bagpipe.storage import Storage, StorageError
from tests.mcap_of_bag import COMPRESSIONS, mcap_of
from tests.rosbag2_folders import FORMS, MS, START, Form, Message, drive, folder
from tests.unit.bagpipe.bags import steady, write_bag

STORAGE = Storage({})
SECOND = 1000 * MS


def options(path: str, **given: Any) -> Any:
    return parse_options({"path": path, **{key: str(value) for key, value in given.items()}})


def rows(path: str, **given: Any) -> list[dict[str, Any]]:
    reader = RosbagReader(options(path, **given))
    found = [
        row
        for partition in reader.partitions()
        for batch in reader.read(partition)
        for row in batch.to_pylist()
    ]
    return sorted(found, key=lambda row: (row["time_ns"], row["topic"]))


def halves(recorded: list[Message]) -> list[list[Message]]:
    return [recorded[:30], recorded[30:]]


@pytest.mark.parametrize("compression", sorted(COMPRESSIONS))
def test_mcap_has_the_rows_of_the_bag(compression: str, tmp_path: Path) -> None:
    recorded = steady("/a", 100, SECOND // 10, SECOND) + steady("/b", 10, SECOND, SECOND)
    bag = write_bag(tmp_path / "a.bag", sorted(recorded, key=lambda m: m.time), chunk_bytes=2048)
    mcap = mcap_of(bag, tmp_path / "a.mcap", compression, 2048)
    for given in ({}, {"topics": "/b", "fragment": 3}, {"start": 4 * SECOND, "end": 6 * SECOND}):
        expected = rows(bag.as_uri(), **given)
        assert rows(mcap.as_uri(), **given) == expected
        assert len(expected) in (110, 10, 22)
    decoded = rows(mcap.as_uri(), topics="/a", decode="true")
    assert decoded == rows(bag.as_uri(), topics="/a", decode="true")
    assert len(decoded) == 100


@pytest.mark.parametrize("form", FORMS, ids=str)
def test_a_folder_has_every_message_once(form: Form, tmp_path: Path) -> None:
    recorded = drive()
    metadata = folder(tmp_path / "drive", form, halves(recorded))
    for path in (
        metadata.as_uri(),
        f"{metadata.parent.as_uri()}/",
        f"{metadata.parent.as_uri()}/*",
    ):
        found = rows(path, fragment=2)
        assert [(r["topic"], r["time_ns"], r["data"], r["type"]) for r in found] == [
            (m.topic, m.time, m.data, m.type) for m in recorded
        ]
        assert {row["md5sum"] for row in found} == {""}
    start, end = START + SECOND, START + 2 * SECOND
    found = rows(metadata.as_uri(), topics="/a", start=start, end=end)
    wanted = [m for m in recorded if m.topic == "/a" and start <= m.time < end]
    assert [row["data"] for row in found] == [m.data for m in wanted]
    decoded = rows(metadata.as_uri(), topics="/a", decode="true", start=start, end=end)
    words = [f"message {number}" for number in range(10, 20, 2)]
    assert [row["message"] for row in decoded] == [{"data": word} for word in words]


def test_fragments_of_a_folder_read_only_what_they_need(tmp_path: Path) -> None:
    metadata = folder(tmp_path / "drive", Form("mcap"), halves(drive()))
    fragments = plan(options(metadata.as_uri(), topics="/a", fragment=1), STORAGE)
    assert len(fragments) == 6
    # The cuts meet the file's end, where a chunk begins.
    assert {len(fragment.parts) for fragment in fragments} == {1}
    sizes = sum(path.stat().st_size for path in metadata.parent.glob("*.mcap"))
    assert all(sum(part.bytes for part in each.parts) < sizes / 2 for each in fragments)


def test_only_the_fragments_that_are_narrowed_look_at_all_chunks_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    narrowed = list[int]()

    def counted(tail: BagTail, topics: list[str], window: Window) -> FragmentPlan:
        narrowed.append(window.start)
        return cut_one(tail, topics, window)

    monkeypatch.setattr(planning, "cut_one", counted)
    metadata = folder(tmp_path / "drive", Form("mcap"), halves(drive()))
    whole = plan(options(metadata.as_uri(), topics="/a", fragment=1), STORAGE)
    assert (len(whole), narrowed) == (6, [])
    start, end = START + 500 * MS, START + 4500 * MS
    some = plan(options(metadata.as_uri(), topics="/a", fragment=1, start=start, end=end), STORAGE)
    assert len(some) == 5
    assert (narrowed, some[0].window.start, some[-1].window.end) == (
        [start, some[-1].window.start], start, end,
    )  # fmt: skip
    assert some[1:-1] == whole[1:4]
    # Before all messages is no message, and not each.
    assert plan(options(metadata.as_uri(), end=0), STORAGE) == []


def test_values_of_ros_2_come_out_as_they_went_in() -> None:
    store = get_typestore(Stores.ROS2_HUMBLE)
    header = store.types["std_msgs/msg/Header"]
    time = store.types["builtin_interfaces/msg/Time"]
    vector = store.types["geometry_msgs/msg/Vector3"]
    name = "geometry_msgs/msg/Vector3Stamped"
    message = store.types[name](header(time(5, 7), "map"), vector(1.0, 2.5, -3.0))
    data = bytes(store.serialize_cdr(message, name))
    definition = store.generate_msgdef(name, ros_version=2)[0]
    decoder = Decoder(TopicType("/v", name, "", definition, "cdr", "ros2msg"))
    assert decoder.decode(data) == {
        "header": {"stamp": 5_000_000_007, "frame_id": "map"},
        "vector": {"x": 1.0, "y": 2.5, "z": -3.0},
    }
    idl = "module std_msgs { module msg { struct String { string data; }; }; };\n"
    parts = "=" * 80 + "\nIDL: std_msgs/msg/String\n" + idl
    for text in (idl, parts):
        kind = TopicType("/s", "std_msgs/msg/String", "", text, "cdr", "ros2idl")
        assert Decoder(kind).decode(b"\0\1\0\0\3\0\0\0hi\0") == {"data": "hi"}


def test_what_can_t_be_read_names_the_recording(tmp_path: Path) -> None:
    metadata = folder(tmp_path / "drive", Form("mcap"), halves(drive()))
    (tmp_path / "other").mkdir()
    (fragment, *_) = plan(options(metadata.as_uri(), fragment=2), STORAGE)
    file = metadata.with_name("drive_0.mcap")
    file.write_bytes(file.read_bytes() + b"more")
    with pytest.raises(StorageError, match="no longer the file that was planned"):
        list(messages(fragment, STORAGE))
    with pytest.raises(StorageError, match=r"drive/metadata.yaml: drive_0.mcap: the recording is"):
        plan(options(metadata.as_uri()), STORAGE)
    with pytest.raises(StorageError, match="names no bag"):
        plan(options(f"{(tmp_path / 'other').as_uri()}/"), STORAGE)


def test_one_topic_of_two_types_has_no_columns(tmp_path: Path) -> None:
    folder(tmp_path / "a", Form("mcap"), [drive()])
    other = [each._replace(type="std_msgs/msg/Other") for each in drive()]
    folder(tmp_path / "b", Form("mcap"), [other])
    given = options(f"{tmp_path.as_uri()}/*/", topics="/a", decode="true")
    with pytest.raises(StorageError, match=r"has 2 types \(std_msgs/msg/Other, std_"):
        topic_type(given, STORAGE)
