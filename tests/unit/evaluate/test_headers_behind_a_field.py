"""Stamps of a type whose header is not its first field are believed as they are."""

import io
from typing import Any

from mcap.writer import CompressionType, Writer
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from bagpipe.evaluate.evidence import Evidence, Recording
from bagpipe.evaluate.judge import evaluate
from bagpipe.evaluate.model import Criterion

S = 1_000_000_000
STORE = get_typestore(Stores.ROS2_HUMBLE)
FIRST = "std_msgs/Header header\nfloat64 x\n"
SECOND = "float64 x\nstd_msgs/Header header\n"


def made(definition: str, entries: list[tuple[float, float, float]]) -> bytes:
    store = get_typestore(Stores.ROS2_HUMBLE)
    store.register(get_types_from_msg(definition, "p/msg/X"))
    stream = io.BytesIO()
    writer = Writer(stream, chunk_size=4096, compression=CompressionType.NONE)
    writer.start(profile="ros2", library="t")
    text, _ = store.generate_msgdef("p/msg/X", ros_version=2)
    schema = writer.register_schema("p/msg/X", "ros2msg", text.encode())
    channel = writer.register_channel("/x", "cdr", schema)
    time: Any = store.types["builtin_interfaces/msg/Time"]
    header: Any = store.types["std_msgs/msg/Header"]
    for at, stamp, x in entries:
        ns = round(stamp * S)
        value = store.types["p/msg/X"](header=header(time(ns // S, ns % S), "map"), x=x)
        data = bytes(store.serialize_cdr(value, "p/msg/X"))
        writer.add_message(channel, round(at * S), data, round(at * S))
    writer.finish()
    return stream.getvalue()


def judged(definition: str, shift: float) -> Any:
    truth = [(10 + i * 0.1, 10 + i * 0.1, float(i)) for i in range(100)]
    # The stack answers at each moment what it expects of `shift` seconds later, stamped so.
    answered = [(10 + i * 0.1, 10 + i * 0.1 + shift, float(i + shift * 10)) for i in range(100)]
    evidence = Evidence(
        recorded=Recording(lambda: made(definition, answered), 10 * S, None),
        source=Recording(lambda: made(definition, truth), 10 * S, 20 * S),
        start=10 * S,
        end=20 * S,
    )
    limits = {"recording": True, "max": 0.1, "minCoverage": 0.5}
    wanted = {"name": "e", "error": {"topic": "/x", "fields": ["x"]} | limits}
    (found,) = evaluate([Criterion.model_validate(wanted)], evidence)
    return found


def test_stamps_of_the_future_are_no_evidence_wherever_the_header_stands() -> None:
    assert judged(FIRST, 0.0).outcome == judged(SECOND, 0.0).outcome == "passed"
    assert judged(FIRST, 2.0).outcome == "invalid"
    assert judged(SECOND, 2.0).outcome == "invalid", judged(SECOND, 2.0)
