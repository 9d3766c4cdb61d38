"""The messages of tests as ROS 2 has them, in MCAP written by MCAP's own library."""

import io
from collections.abc import Container, Iterable
from functools import cache
from typing import Any

from mcap.writer import CompressionType, Writer
from rosbags.interfaces import Nodetype
from rosbags.typesys import Stores, get_typestore

STORE = get_typestore(Stores.ROS2_HUMBLE)
_LINE = "=" * 80
# As rosbag2 writes them since Jazzy, and before.
_VOLATILE = "- history: keep_last\n  depth: 10\n  reliability: reliable\n  durability: volatile\n"
_LATCHED = "- history: 1\n  depth: 1\n  reliability: 1\n  durability: 1\n"
_IDL = {
    "int8": "int8", "uint8": "uint8", "int16": "int16", "uint16": "uint16", "int32": "int32",
    "uint32": "uint32", "int64": "int64", "uint64": "uint64", "float32": "float",
    "float64": "double", "bool": "boolean", "byte": "octet", "char": "uint8", "string": "string",
}  # fmt: skip


def as_ros2(value: Any) -> Any:
    """A message of ROS 1 as the same of ROS 2, whose headers have no sequence number."""
    if isinstance(value, list):
        return [as_ros2(each) for each in value]
    name = getattr(value, "__msgtype__", None)
    if name is None:
        return value
    fields = [field for field, _ in STORE.fielddefs[name][1]]
    return STORE.types[name](**{field: as_ros2(getattr(value, field)) for field in fields})


def mcap(
    entries: Iterable[tuple[str, float, Any]],
    latching: Container[str] = (),
    schema: str = "ros2msg",
    *,
    little_endian: bool = True,
    compression: CompressionType = CompressionType.NONE,
) -> bytes:
    """(topic, receipt in seconds, message of ROS 1) as MCAP of ROS 2; `schema` is its language."""
    stream = io.BytesIO()
    writer = Writer(stream, chunk_size=4096, compression=compression)
    writer.start(profile="ros2", library="tests")
    schemas: dict[str, int] = {}
    channels: dict[tuple[str, str], int] = {}
    for topic, seconds, message in sorted(entries, key=lambda entry: entry[1]):
        name = message.__msgtype__
        if name not in schemas:
            schemas[name] = writer.register_schema(name, schema, definition(name, schema).encode())
        if (topic, name) not in channels:
            qos = {"offered_qos_profiles": _LATCHED if topic in latching else _VOLATILE}
            channels[topic, name] = writer.register_channel(topic, "cdr", schemas[name], qos)
        time = round(seconds * 1_000_000_000)
        data = STORE.serialize_cdr(as_ros2(message), name, little_endian=little_endian)
        writer.add_message(channels[topic, name], time, bytes(data), time)
    writer.finish()
    return stream.getvalue()


@cache
def definition(name: str, schema: str) -> str:
    """A type's full definition, with those that it uses."""
    if schema == "ros2msg":
        text: str = STORE.generate_msgdef(name, ros_version=2)[0]
        return text
    return "".join(f"{_LINE}\nIDL: {used}\n{_module(used)}" for used in _used(name))


def _used(name: str) -> list[str]:
    """The type and those within it, each once, itself first."""
    found = [name]
    for _, field in STORE.fielddefs[name][1]:
        inner = field[1][0] if field[0] in (Nodetype.ARRAY, Nodetype.SEQUENCE) else field
        if inner[0] == Nodetype.NAME:
            found += [each for each in _used(inner[1]) if each not in found]
    return found


def _module(name: str) -> str:
    package, folder, short = name.split("/")
    fields = "".join(f"      {_field(field, of)};\n" for field, of in STORE.fielddefs[name][1])
    return (
        f"module {package} {{\n  module {folder} {{\n    struct {short} {{\n{fields}    }};\n"
        "  };\n};\n\n"
    )


def _field(name: str, field: Any) -> str:
    kind, detail = field
    if kind == Nodetype.SEQUENCE:
        return f"sequence<{_type(detail[0])}> {name}"
    assert kind != Nodetype.ARRAY, "no such type is used by a test"
    return f"{_type(field)} {name}"


def _type(field: Any) -> str:
    kind, detail = field
    return _IDL[detail[0]] if kind == Nodetype.BASE else detail.replace("/", "::")
