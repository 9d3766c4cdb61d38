"""`bagpipe bag convert --messages ros1`: recordings of ROS 2 for a stack of ROS 1."""

import io
from pathlib import Path
from typing import Any

import pytest
from mcap.writer import Writer
from rosbags.rosbag1 import Reader
from rosbags.typesys import Stores, get_typestore

from bagpipe import MemoryBag
from tests.rosbag2_folders import FORMS, Form, drive, folder
from tests.unit.bagpipe.bags import Recorded, steady, write_bag
from tests.unit.cli.test_bag_formats import as_json, complaint, run

OLD, NEW = get_typestore(Stores.ROS1_NOETIC), get_typestore(Stores.ROS2_JAZZY)
ROS1 = ("--messages", "ros1")


def one_of(
    kind: str,
    message: Any,
    into: Path,
    encoding: str = "cdr",
    topic: str = "/a",
    time: int = 7,
) -> Path:
    """MCAP of one message."""
    stream = io.BytesIO()
    writer = Writer(stream)
    writer.start()
    definition = str(NEW.generate_msgdef(kind, ros_version=2)[0])
    schema = writer.register_schema(kind, "ros2msg", definition.encode())
    raw = message if isinstance(message, bytes) else bytes(NEW.serialize_cdr(message, kind))
    writer.add_message(writer.register_channel(topic, encoding, schema), time, raw, time)
    writer.finish()
    into.write_bytes(stream.getvalue())
    return into


@pytest.mark.parametrize("packing", ["none", "lz4", "bz2"])
def test_what_was_of_ros_1_is_the_same_bag_again(packing: str, tmp_path: Path) -> None:
    messages = [*steady("/scan", 50, 10_000_000), Recorded("/map", 1_100_000_005, "m", True)]
    bag = write_bag(tmp_path / "drive.bag", sorted(messages, key=lambda one: one.time), 512)
    there, back = tmp_path / "drive.mcap", tmp_path / "back.bag"
    as_json("convert", bag, "--to", there, "--messages", "ros2")
    shown = as_json("convert", there, "--to", back, *ROS1, "--compression", packing)
    assert (shown["messages"], shown["start"], shown["end"]) == (51, 1_000_000_000, 1_490_000_000)
    assert run("check", back)[0] == 0

    def content(path: Path) -> list[Any]:
        fields = ("topic", "type", "md5sum", "definition", "callerid", "latching")
        return [
            (*(getattr(connection, field) for field in fields), time, bytes(raw))
            for connection, time, raw in MemoryBag.open(path).messages()
        ]

    assert content(back) == content(bag)


@pytest.mark.parametrize("form", FORMS, ids=str)
def test_another_reader_has_each_value_of_a_folder_of_rosbag2(form: Form, tmp_path: Path) -> None:
    messages = drive()
    place = folder(tmp_path / "drive", form, [messages]).parent
    made = tmp_path / "whole.bag"
    as_json("convert", place, "--to", made, *ROS1)
    with Reader(made) as reader:
        latched = {one.topic for one in reader.connections if getattr(one.ext, "latching", None)}
        sums = {one.msgtype: one.digest for one in reader.connections}
        found = [
            (one.topic, time, repr(OLD.deserialize_ros1(raw, one.msgtype)).replace("seq=0, ", ""))
            for one, time, raw in reader.messages()
        ]
    assert latched == {"/map"}
    kinds = {one.topic: one.type for one in messages}
    expected = [
        (one.topic, one.time, repr(NEW.deserialize_cdr(one.data, kinds[one.topic])))
        for one in sorted(messages, key=lambda one: one.time)
    ]
    assert sorted(found) == sorted(expected)
    assert sums == {kind: OLD.generate_msgdef(kind, ros_version=1)[1] for kind in sums}


def test_what_cannot_be_one_of_ros_1_is_refused_and_nothing_is_written(tmp_path: Path) -> None:
    target = tmp_path / "new.bag"
    header = NEW.types["std_msgs/msg/Header"](NEW.types["builtin_interfaces/msg/Time"](1, 2), "")
    kind = "sensor_msgs/msg/Range"
    range_with = one_of(
        kind, NEW.types[kind](header, 1, 0.5, 0.1, 2.0, 1.5, 0.25), tmp_path / "range.mcap"
    )
    text = " ".join(complaint("convert", range_with, "--to", target, *ROS1).split())
    assert "the message of /a at 7 ns: its sensor_msgs/msg/Range.variance is not empty" in text
    cut = one_of("std_msgs/msg/String", b"\0\1\0\0\5\0\0\0abc", tmp_path / "cut.mcap")
    text = " ".join(complaint("convert", cut, "--to", target, *ROS1).split())
    assert "the message of /a at 7 ns: it is no std_msgs/msg/String" in text
    assert "`bagpipe bag slice --topic`" in text
    other = one_of("std_msgs/msg/String", b"{}", tmp_path / "other.mcap", "json")
    text = " ".join(complaint("convert", other, "--to", target, *ROS1).split())
    assert "has topics that ROS 1 can't have: /a: its messages are in json" in text
    string = NEW.types["std_msgs/msg/String"]("a")
    odd = one_of("std_msgs/msg/String", string, tmp_path / "odd.mcap", topic="/a-b")
    text = " ".join(complaint("convert", odd, "--to", target, *ROS1).split())
    assert "/a-b: no topic of ROS 1 can have this name" in text
    for time in (10**9 << 32, 2**64 - 1):
        late = one_of("std_msgs/msg/String", string, tmp_path / "late.mcap", time=time)
        text = " ".join(complaint("convert", late, "--to", target, *ROS1).split())
        assert f"of /a was logged at {time} ns, and a bag's time ends in 2106" in text
    text = complaint("convert", cut, "--to", tmp_path / "new.mcap", *ROS1)
    assert "let --to end in .bag" in " ".join(text.split())
    text = complaint("convert", cut, "--to", target, *ROS1, "--compression", "zstd")
    assert "a bag has no zstd" in " ".join(text.split())
    assert sorted(path.name for path in tmp_path.glob("new*")) == []


def test_fields_that_ros_1_alone_has_are_named(tmp_path: Path) -> None:
    kind = "sensor_msgs/msg/Range"
    definition = str(NEW.generate_msgdef(kind, ros_version=2)[0]).replace("float32 range\n", "")
    stream = io.BytesIO()
    writer = Writer(stream)
    writer.start()
    schema = writer.register_schema(kind, "ros2msg", definition.encode())
    channel = writer.register_channel("/a", "cdr", schema)
    # A header of two numbers and an empty text, a byte, and the rest.
    raw = b"\0\1\0\0" + bytes(8) + b"\1\0\0\0\0\1\0\0" + bytes(16)
    writer.add_message(channel, 5, raw, 5)
    writer.finish()
    source = tmp_path / "range.mcap"
    source.write_bytes(stream.getvalue())
    text = run("convert", source, "--to", tmp_path / "new.bag", *ROS1)[1]
    assert "fields that ROS 1 alone has are 0 or empty: sensor_msgs/msg/Range.range" in text
