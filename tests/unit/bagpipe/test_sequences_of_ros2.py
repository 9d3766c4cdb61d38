"""Pieces of recordings of ROS 2 as one case: the MCAP that is made of them, read by others."""

from pathlib import Path
from typing import Any

import pytest
from mcap.reader import make_reader
from mcap.writer import Writer
from rosbags.typesys import Stores, get_typestore

import bagpipe
from bagpipe.encodings import CDR
from bagpipe.plan.case import Case
from bagpipe.source.chosen import source_of
from bagpipe.source.planning import plan
from bagpipe.source.sequence.stream import sequence
from bagpipe.spec import SimulationJobSpec
from bagpipe.storage import Storage
from bagpipe.wire.session import InputFile, SessionError
from tests import ros2_recording
from tests.ros2_recording import BEGIN, IMU, QOS, imu
from tests.unit.bagpipe.bags import steady, write_bag
from tests.unit.bagpipe.jobs import make_spec

MS = 1_000_000
STORE = get_typestore(Stores.ROS2_HUMBLE)
LATCHED = QOS.replace("volatile", "transient_local").replace("depth: 10", "depth: 1")
Found = list[tuple[str, int, bytes, str]]


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """a.mcap: 100 messages of /in in turn with /more, 5 ms after each other; b.mcap: 40 of /in."""
    ros2_recording.write(tmp_path / "a.mcap", ["/in", "/more"], 100)
    ros2_recording.write(tmp_path / "b.mcap", ["/in"], 40)
    return tmp_path


def spec_of(pieces: list[dict[str, Any]], **source: Any) -> SimulationJobSpec:
    written = [{**each, "bag": f"pvc://recordings/{each['bag']}"} for each in pieces]
    stack = {"engine": "ros2", "image": "i", "command": ["c"]}
    return make_spec(source={"sequence": written, **source}, stack=stack)


def planned(folder: Path, spec: SimulationJobSpec) -> Case:
    made = plan(spec, Storage({"recordings": str(folder)}))
    assert made.unplanned == []
    (case,) = made.cases
    return case


def read_by_others(data: bytes | memoryview, folder: Path) -> Found:
    """Topic, time, bytes and publishers' profiles of each message, in the order of time."""
    path = folder / "made.mcap"
    path.write_bytes(data)
    with path.open("rb") as stream:
        return [
            (
                channel.topic,
                message.log_time,
                message.data,
                channel.metadata["offered_qos_profiles"],
            )
            for _, channel, message in make_reader(stream).iter_messages()
        ]


def test_the_parts_are_one_file_of_mcap_with_stamps_and_profiles(folder: Path) -> None:
    pieces: list[dict[str, Any]] = [
        {"bag": "a.mcap", "from": "100ms", "to": "200ms"},
        {"bag": "b.mcap", "from": "50ms", "to": "100ms", "times": 2, "pause": "7ms"},
    ]
    spec = spec_of(pieces, topics=["/in"])
    case = planned(folder, spec)
    made = sequence(case, Storage({"recordings": str(folder)}), CDR)
    # Numbers and the times of their first recording, and when they are played.
    of_a = [(number, BEGIN + number * 5 * MS) for number in range(20, 40, 2)]
    first, second = BEGIN + 207 * MS, BEGIN + 264 * MS
    of_b = [(10 + number, at + number * 5 * MS) for at in (first, second) for number in range(10)]
    expected = [("/in", time, imu(time, number), QOS) for number, time in of_a + of_b]
    assert read_by_others(made, folder) == expected
    assert len(bagpipe.MemoryMcap(made).connections) == 1
    assert case.window.end == second + 50 * MS


def test_what_the_agent_and_a_laptop_get_is_that_file(folder: Path) -> None:
    spec = spec_of([{"bag": "b.mcap"}, {"bag": "a.mcap", "to": "20ms"}])
    case, storage = planned(folder, spec), Storage({"recordings": str(folder)})
    source = source_of(spec)
    made = bytes(sequence(case, storage, CDR))
    given = source.input(case, storage)
    assert isinstance(given, InputFile)
    assert (source.file_name(case), given.size) == ("sequence.mcap", len(made))
    assert b"".join(given.pieces()) == made == source.truth(case, {"/in"}, storage)
    times = source.input_times(case, storage)
    assert times is not None
    assert times() == [time for _, time, _, _ in read_by_others(made, folder)]
    assert source.begin(case, storage, folder / "made.mcap") == BEGIN


def test_a_part_begins_with_what_each_publisher_latched_before_it(folder: Path) -> None:
    texts = [STORE.types["std_msgs/msg/String"](data=data) for data in ("old", "map", "later")]
    raw = [bytes(STORE.serialize_cdr(each, "std_msgs/msg/String")) for each in texts]
    with (folder / "c.mcap").open("wb") as stream:
        writer = Writer(stream)
        writer.start(profile="ros2")
        schema = writer.register_schema("std_msgs/msg/String", "ros2msg", b"string data\n")
        metadata = {"offered_qos_profiles": LATCHED}
        channel = writer.register_channel("/map", "cdr", schema, metadata=metadata)
        for time, data in zip((0, 10, 90), raw, strict=True):
            writer.add_message(channel, BEGIN + time * MS, data, BEGIN + time * MS)
        writer.finish()
    spec = spec_of([{"bag": "c.mcap", "from": "50ms"}, {"bag": "c.mcap", "to": "5ms"}])
    made = sequence(planned(folder, spec), Storage({"recordings": str(folder)}), CDR)
    found = [(time - BEGIN, data, qos) for _, time, data, qos in read_by_others(made, folder)]
    assert found == [
        # Just before the first part, which is played from 50 ms on.
        (50 * MS - 1, raw[1], LATCHED),
        (90 * MS, raw[2], LATCHED),
        (90 * MS + 1, raw[0], LATCHED),
    ]


def test_a_bag_of_ros_1_is_refused(folder: Path) -> None:
    write_bag(folder / "old.bag", steady("/scan", 10, 100 * MS))
    spec = spec_of([{"bag": "b.mcap"}, {"bag": "old.bag"}])
    made = plan(spec, Storage({"recordings": str(folder)}))
    assert made.cases == []
    assert "/scan holds messages in ros1, and the stack would read them as cdr" in str(
        made.unplanned
    )


def test_a_sequence_of_more_than_there_is_room_for_says_so(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    case = planned(folder, spec_of([{"bag": "b.mcap", "times": 3}]))
    monkeypatch.setattr("bagpipe.source.sequence.stream.MOST_BYTES", 30_000)
    with pytest.raises(SessionError, match=r"the sequence does not fit: .*Make it shorter"):
        sequence(case, Storage({"recordings": str(folder)}), CDR)


def test_of_a_writer_that_is_finished_nothing_more_is_had() -> None:
    writer = bagpipe.MemoryMcapWriter()
    assert bagpipe.MemoryMcap(writer.finish()).connections == []
    with pytest.raises(ValueError, match="the file is finished"):
        writer.finish()


def test_imus_are_what_was_written(folder: Path) -> None:
    data = (folder / "b.mcap").read_bytes()
    (connection,) = bagpipe.MemoryMcap(data).connections
    assert (connection.type, connection.offered_qos) == (IMU, QOS)
