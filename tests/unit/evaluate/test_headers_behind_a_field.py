"""Of a type whose header is not its first field: its stamps, and which messages are alike."""

import io
from typing import Any

from mcap.writer import CompressionType, Writer
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from bagpipe import MemoryBag
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


def counted(definition: str, make: Any) -> Any:
    """Of each of a hundred stamps twice what `make` gives for the header, and 0 or 1."""
    store = get_typestore(Stores.ROS1_NOETIC)
    store.register(get_types_from_msg(definition, "p/msg/X"))
    text, md5 = store.generate_msgdef("p/msg/X")
    time: Any = store.types["builtin_interfaces/msg/Time"]
    header: Any = store.types["std_msgs/msg/Header"]
    writer = MemoryBag.writer()
    for step in range(100):
        for copy in (0, 1):
            ns = 10 * S + step * S // 10
            head = header(2 * step + copy, time(ns // S, ns % S), "map")
            value = store.types["p/msg/X"](**make(head, copy))
            data = bytes(store.serialize_ros1(value, "p/msg/X"))
            writer.write("/x", ns, data, type="p/X", md5sum=md5, definition=text)
    data = writer.finish().to_bytes()
    recorded = Recording(lambda: data, 10 * S, None)
    evidence = Evidence(recorded=recorded, source=recorded, start=10 * S, end=20 * S)
    wanted = {"name": "e", "presence": {"topic": "/x", "min": 200}}
    (found,) = evaluate([Criterion.model_validate(wanted)], evidence)
    return found.figure


def test_messages_repeat_each_other_that_differ_in_the_number_of_their_header_alone() -> None:
    behind = "uint32 id\nbool on\nstd_msgs/Header header\nuint8 state\n"

    def two(head: Any, copy: int) -> Any:
        return {"id": copy, "on": True, "header": head, "state": 1}

    assert counted(behind, two) == 200
    assert counted(behind, lambda head, _: two(head, 0)) == 100
    assert counted(behind, lambda head, copy: two(head, 0) | {"state": copy}) == 200
    first = "std_msgs/Header header\nuint8 state\n"
    assert counted(first, lambda head, copy: {"header": head, "state": copy}) == 200
    assert counted(first, lambda head, _: {"header": head, "state": 1}) == 100


def test_behind_a_text_the_number_of_a_header_makes_a_message_another_one() -> None:
    """Where it stands is then not the same in all of them."""
    definition = "string name\nstd_msgs/Header header\n"
    assert counted(definition, lambda head, copy: {"name": f"{copy}", "header": head}) == 200
    assert counted(definition, lambda head, _: {"name": "", "header": head}) == 200
