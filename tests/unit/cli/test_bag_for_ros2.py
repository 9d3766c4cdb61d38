"""`bagpipe bag convert --messages ros2`: recordings of ROS 1 for a stack of ROS 2."""

import io
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
import yaml
from mcap.reader import make_reader
from mcap.writer import Writer
from rosbags.typesys import Stores, get_typestore

from bagpipe import MemoryBag
from tests.mcap_of_bag import mcap_of
from tests.rosbag2_folders import FORMS, drive, folder, read_mcap
from tests.unit.bagpipe.bags import Recorded, steady, write_bag
from tests.unit.cli.test_bag_formats import as_json, complaint, run

OLD, NEW = get_typestore(Stores.ROS1_NOETIC), get_typestore(Stores.ROS2_JAZZY)
STRING = "std_msgs/msg/String"


def text_of(message: Any) -> str:
    return str(message.data)


@pytest.fixture
def bag(tmp_path: Path) -> Path:
    """Fifty messages of /scan, and one of /map that is latched."""
    messages = [*steady("/scan", 50, 10_000_000), Recorded("/map", 1_100_000_005, "m", True)]
    return write_bag(tmp_path / "drive.bag", sorted(messages, key=lambda one: one.time), 512)


def one_of(kind: str, raw: bytes, into: Path, encoding: str = "ros1") -> Path:
    """MCAP of one message of /a, as ROS 1 has its type."""
    definition = OLD.generate_msgdef(kind, ros_version=1)[0]
    stream = io.BytesIO()
    writer = Writer(stream)
    writer.start()
    schema = writer.register_schema(kind.replace("/msg/", "/"), "ros1msg", definition.encode())
    writer.add_message(writer.register_channel("/a", encoding, schema), 7, raw, 7)
    writer.finish()
    into.write_bytes(stream.getvalue())
    return into


@pytest.mark.parametrize(
    "source", [lambda bag: bag, lambda bag: mcap_of(bag, bag.with_suffix(".ros1.mcap"), "lz4", 512)]
)
@pytest.mark.parametrize("packing", ["none", "lz4", "zstd"])
def test_each_message_is_there_in_cdr_at_its_time(
    packing: str, source: Callable[[Path], Path], bag: Path, tmp_path: Path
) -> None:
    made = tmp_path / "drive.mcap"
    shown = as_json(
        "convert", source(bag), "--to", made, "--messages", "ros2", "--compression", packing
    )
    assert (shown["messages"], shown["start"], shown["end"]) == (51, 1_000_000_000, 1_490_000_000)
    assert run("check", made)[0] == 0
    expected = [
        (connection.topic, time, text_of(OLD.deserialize_ros1(raw, STRING)))
        for connection, time, raw in MemoryBag.open(bag).messages()
    ]
    with made.open("rb") as stream:
        reader = make_reader(stream)
        found = [
            (
                channel.topic,
                message.log_time,
                text_of(NEW.deserialize_cdr(message.data, schema.name)),
            )
            for schema, channel, message in reader.iter_messages()
            if schema is not None and schema.name == STRING and schema.encoding == "ros2msg"
        ]
        summary = reader.get_summary()
    assert found == expected
    assert summary is not None
    qos = {
        channel.topic: yaml.safe_load(channel.metadata["offered_qos_profiles"])[0]
        for channel in summary.channels.values()
    }
    assert (qos["/map"]["durability"], qos["/map"]["depth"]) == ("transient_local", 1)
    assert (qos["/scan"]["durability"], qos["/scan"]["reliability"]) == ("volatile", "reliable")
    assert {each.message_encoding for each in summary.channels.values()} == {"cdr"}
    names = {each.topic: each.metadata["callerid"] for each in summary.channels.values()}
    assert sorted(names) == ["/map", "/scan"]
    assert sorted(names.values()) == ["/recorded0", "/recorded1"]


def test_what_is_of_ros_2_stays_as_it_is(tmp_path: Path) -> None:
    messages = drive()
    place = folder(tmp_path / "drive", FORMS[0], [messages]).parent
    made = tmp_path / "whole.mcap"
    as_json("convert", place, "--to", made, "--messages", "ros2")
    assert read_mcap(made) == messages


def test_fields_that_ros_2_alone_has_are_named(tmp_path: Path) -> None:
    kind = "sensor_msgs/msg/Range"
    empty = OLD.types["std_msgs/msg/Header"](0, OLD.types["builtin_interfaces/msg/Time"](1, 2), "")
    raw = bytes(OLD.serialize_ros1(OLD.types[kind](empty, 1, 0.5, 0.1, 2.0, 1.5), kind))
    source = one_of(kind, raw, tmp_path / "range.mcap")
    made = as_json("convert", source, "--to", tmp_path / "new.mcap", "--messages", "ros2")
    assert made["added"] == ["sensor_msgs/msg/Range.variance"]
    text = run("convert", source, "--to", tmp_path / "other.mcap", "--messages", "ros2")[1]
    assert "fields that ROS 2 alone has are 0 or empty: sensor_msgs/msg/Range.variance" in text


def test_what_cannot_be_one_of_ros_2_is_refused_and_nothing_is_written(
    bag: Path, tmp_path: Path
) -> None:
    target = tmp_path / "new.mcap"
    solid = one_of("shape_msgs/msg/SolidPrimitive", b"", tmp_path / "solid.mcap")
    text = " ".join(complaint("convert", solid, "--to", target, "--messages", "ros2").split())
    assert "has topics that ROS 2 can't have: /a: shape_msgs/msg/SolidPrimitive.dimensions" in text
    assert "`bagpipe bag slice --topic`" in text
    cut = one_of(STRING, b"\5\0\0\0abc", tmp_path / "cut.mcap")
    text = " ".join(complaint("convert", cut, "--to", target, "--messages", "ros2").split())
    assert "the message of /a at 7 ns: it is no std_msgs/msg/String" in text
    other = one_of(STRING, b"{}", tmp_path / "other.mcap", "json")
    text = complaint("convert", other, "--to", target, "--messages", "ros2")
    assert "/a: its messages are in json" in " ".join(text.split())
    text = complaint("convert", bag, "--to", tmp_path / "new.bag", "--messages", "ros2")
    assert "let --to end in .mcap" in " ".join(text.split())
    packed = ["--messages", "ros2", "--compression", "bz2"]
    assert "MCAP has no bz2" in complaint("convert", bag, "--to", target, *packed)
    assert not target.exists()
    assert json.dumps(sorted(path.name for path in tmp_path.glob("new*"))) == "[]"
