"""Types of a recording that would cost a worker hours are refused, and others are read once."""

import io
from types import SimpleNamespace
from typing import Any

import pytest
from mcap.writer import CompressionType, Writer

from bagpipe import definitions
from bagpipe.evaluate import decoding
from bagpipe.evaluate.evidence import Recording
from bagpipe.evaluate.finding import NoEvidenceError

SECOND = 1_000_000_000
BREAK = "=" * 80 + "\n"
HEADER = f"{BREAK}MSG: std_msgs/Header\nuint32 seq\ntime stamp\nstring frame_id\n"


def doubled(depth: int) -> SimpleNamespace:
    """A connection of ROS 1 with a type whose message has no byte before its header, and 2^depth
    values.
    """
    inner = [f"{BREAK}MSG: p/T{n}\nT{n + 1} a\nT{n + 1} b\n" for n in range(depth)]
    text = f"T0 x\nstd_msgs/Header header\n{''.join(inner)}{BREAK}MSG: p/T{depth}\n\n{HEADER}"
    return SimpleNamespace(
        id=1, topic="/t", type="p/X", definition=text, encoding="ros1", schema_encoding="ros1msg"
    )


@pytest.mark.parametrize("depth", [8, 40])
def test_a_message_of_few_bytes_and_many_values_is_not_decoded(depth: int) -> None:
    connection = doubled(depth)
    assert decoding.stamp_reader(connection) is None
    with pytest.raises(NoEvidenceError, match="p/X on /t can't be read"):
        decoding.decoder(connection)


def test_types_within_types_are_decoded() -> None:
    connection = doubled(3)
    stamp_of = decoding.stamp_reader(connection)
    assert stamp_of is not None
    assert stamp_of(memoryview(bytes(4) + b"\7\0\0\0" + bytes(8))) == 7 * SECOND


def made(channels: int) -> bytes:
    """A topic of many channels, each with a message; every other one has a definition of its own,
    which differs in a comment.
    """
    stream = io.BytesIO()
    writer = Writer(stream, chunk_size=1 << 20, compression=CompressionType.NONE)
    writer.start(profile="ros2", library="t")
    schemas = [
        writer.register_schema("p/msg/X", "ros2msg", f"int32 a # {end}".encode())
        for end in ("here", "there")
    ]
    for number in range(channels):
        metadata = {"n": str(number)}
        channel = writer.register_channel("/x", "cdr", schemas[number % 2], metadata=metadata)
        writer.add_message(channel, number * SECOND, b"\0\1\0\0\7\0\0\0", number * SECOND)
    writer.finish()
    return stream.getvalue()


def test_a_definition_is_read_once_however_many_channels_and_recordings_have_it(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    read: list[str] = []

    def types_in(kind: str, definition: str, schema_encoding: str) -> Any:
        read.append(definition)
        return one(kind, definition, schema_encoding)

    one = definitions.types_in
    monkeypatch.setattr(decoding, "types_in", types_in)
    for kept in (decoding._types_of, decoding._store_of):
        kept.cache_clear()
    data = made(40)
    # For its stamps and for its values, of one case and of the next one.
    for _ in range(2):
        samples = Recording(lambda: data, 0, None).samples("/x")
        assert [each.message.a for each in samples] == [7] * 40
    assert sorted(read) == ["int32 a # here", "int32 a # there"]
