"""Stamps moved in messages of random types, of ROS 1 and ROS 2, beside rosbags' own values."""

import struct
from dataclasses import dataclass
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from bagpipe.source import stamps
from bagpipe.source.stamps import StampError, moved

SECOND = 1_000_000_000
BREAK = "=" * 80
NUMBERS = ["bool", "int8", "uint8", "int16", "uint16", "int32", "int64", "float32", "float64"]
HEADERS = {
    "ros1": "uint32 seq\ntime stamp\nstring frame_id\n",
    "cdr": "builtin_interfaces/Time stamp\nstring frame_id\n",
}
TIME = f"{BREAK}\nMSG: builtin_interfaces/Time\nint32 sec\nuint32 nanosec\n"


@dataclass(frozen=True)
class Field:
    """`base` is a number's name, `string`, `header`, or the fields of another type."""

    base: Any
    array: int | None  # -1: of any length


def fields(inner: st.SearchStrategy[Any]) -> st.SearchStrategy[list[Field]]:
    arrays = st.sampled_from([None, None, -1, 1, 3])
    return st.lists(st.builds(Field, inner, arrays), min_size=1, max_size=4)


PLAIN = st.sampled_from([*NUMBERS, "string", "header"])
TYPES = fields(st.one_of(PLAIN, fields(st.one_of(PLAIN, fields(PLAIN)))))


class Definition:
    """The text of a type and of those in it."""

    def __init__(self, top: list[Field], encoding: str) -> None:
        self.names: dict[int, str] = {}
        self.parts: list[str] = []
        self.text = self._lines(top) + "".join(self.parts)
        self.text += f"{BREAK}\nMSG: std_msgs/Header\n{HEADERS[encoding]}"
        self.text += TIME if encoding == "cdr" else ""

    def _lines(self, listed: list[Field]) -> str:
        lines = ""
        for at, field in enumerate(listed):
            array = {None: "", -1: "[]"}.get(field.array, f"[{field.array}]")
            lines += f"{self._name(field.base)}{array} f{at}\n"
        return lines

    def _name(self, base: Any) -> str:
        if isinstance(base, str):
            return {"header": "std_msgs/Header"}.get(base, base)
        name = f"x/Part{len(self.names)}"
        self.names[id(base)] = name
        self.parts.append(f"{BREAK}\nMSG: {name}\n{self._lines(base)}")
        return name


class Made:
    """Values of one type, whose stamps are all the same."""

    def __init__(self, definition: Definition, store: Any, seconds: int, draw: Any) -> None:
        self._names, self._store = definition.names, store
        self._seconds, self._draw = seconds, draw

    def message(self, name: str, listed: list[Field]) -> Any:
        values = [self._field(field) for field in listed]
        return self._store.types[name.replace("/", "/msg/")](*values)

    def _field(self, field: Field) -> Any:
        if field.array is None:
            return self._one(field.base)
        count = self._draw(st.integers(0, 3)) if field.array < 0 else field.array
        values = [self._one(field.base) for _ in range(count)]
        numeric = isinstance(field.base, str) and field.base in NUMBERS
        return np.array(values, dtype=field.base) if numeric else values

    def _one(self, base: Any) -> Any:
        if base == "header":
            types = self._store.types
            header = types["std_msgs/msg/Header"]
            stamp = types["builtin_interfaces/msg/Time"](self._seconds, 5)
            only_in_ros1 = {"seq": 7} if "seq" in header.__dataclass_fields__ else {}
            return header(stamp=stamp, frame_id="m" * self._draw(st.integers(0, 5)), **only_in_ros1)
        if base == "string":
            return "t" * self._draw(st.integers(0, 5))
        if isinstance(base, str):
            return np.dtype(base).type(1)
        return self.message(self._names[id(base)], base)


@pytest.mark.parametrize("encoding", ["ros1", "cdr"])
@settings(max_examples=300, deadline=None)
@given(TYPES, st.data())
def test_every_header_is_moved_and_no_other_byte(
    encoding: str, top: list[Field], data: st.DataObject
) -> None:
    definition = Definition(top, encoding)
    store = get_typestore(Stores.EMPTY)
    types = get_types_from_msg(definition.text, "x/msg/Top")
    if encoding == "ros1":
        base = get_typestore(Stores.ROS1_NOETIC)
        time = "builtin_interfaces/msg/Time"
        types[time] = base.fielddefs[time]
    store.register(types)
    write = store.serialize_ros1 if encoding == "ros1" else store.serialize_cdr
    drawn: list[int] = []

    def draw(strategy: Any) -> int:
        drawn.append(data.draw(strategy))
        return drawn[-1]

    raw = bytes(write(Made(definition, store, 40, draw).message("x/Top", top), "x/msg/Top"))
    again = iter(drawn[:])
    later = Made(definition, store, 42, lambda _: next(again)).message("x/Top", top)
    schema = {"ros1": "ros1msg", "cdr": "ros2msg"}[encoding]
    connection = SimpleNamespace(
        type="x/Top", definition=definition.text, encoding=encoding, schema_encoding=schema
    )
    assert moved(connection, raw, 2 * SECOND) == bytes(write(later, "x/msg/Top"))
    # What is cut off is refused, or ended behind the last header.
    for end in range(len(raw)):
        try:
            assert len(moved(connection, raw[:end], SECOND)) == end
        except StampError as error:
            assert f"a message of {end} bytes" in str(error)


def cdr(definition: str, schema: str = "ros2msg") -> SimpleNamespace:
    return SimpleNamespace(
        type="x/msg/T", definition=definition, encoding="cdr", schema_encoding=schema
    )


HEADER = f"{BREAK}\nMSG: std_msgs/Header\n{HEADERS['cdr']}{TIME}"
BIG, LITTLE = b"\0\0\0\0", b"\0\1\0\0"


def stamped(order: str, seconds: int) -> bytes:
    return struct.pack(f"{order}iII", seconds, 5, 2) + b"m\0"


def test_the_other_order_of_bytes_is_kept() -> None:
    definition = cdr(f"uint8[] before\nstd_msgs/Header header\n{HEADER}")
    before = struct.pack(">I", 1) + b"\xff\0\0\0"
    found = moved(definition, BIG + before + stamped(">", 7), SECOND)
    assert found == BIG + before + stamped(">", 8)


def test_a_type_of_nothing_takes_a_byte() -> None:
    text = f"Nothing a\nstd_msgs/Header header\n{BREAK}\nMSG: x/Nothing\n{HEADER}"
    found = moved(cdr(text), LITTLE + bytes(4) + stamped("<", 7), SECOND)
    assert found == LITTLE + bytes(4) + stamped("<", 8)


def test_definitions_in_idl_are_walked() -> None:
    bodies = {
        "x/msg/T": "double d; std_msgs::msg::Header h;",
        "std_msgs/msg/Header": "builtin_interfaces::msg::Time stamp; string frame_id;",
        "builtin_interfaces/msg/Time": "int32 sec; uint32 nanosec;",
    }
    text = ""
    for name, body in bodies.items():
        package, _, own = name.split("/")
        module = f"module {package} {{ module msg {{ struct {own} {{ {body} }}; }}; }};"
        text += f"{BREAK}\nIDL: {name}\n{module}\n"
    found = moved(cdr(text, "ros2idl"), LITTLE + bytes(8) + stamped("<", 7), SECOND)
    assert found == LITTLE + bytes(8) + stamped("<", 8)


def test_seconds_of_ros_2_end_in_2038() -> None:
    definition = cdr(f"std_msgs/Header header\n{HEADER}")
    found = moved(definition, LITTLE + stamped("<", 7), 1 << 62)
    assert found[4:12] == struct.pack("<iI", (1 << 31) - 1, 0)


@pytest.mark.parametrize("raw", [b"", b"\0\1\0", b"\0\2\0\0" + bytes(40), b"\1\1\0\0" + bytes(40)])
def test_what_is_no_cdr_is_refused(raw: bytes) -> None:
    with pytest.raises(StampError, match=f"a message of {len(raw)} bytes does not begin as CDR"):
        moved(cdr(f"std_msgs/Header header\n{HEADER}"), raw, SECOND)


def test_a_number_of_elements_that_can_t_be_there_ends_at_once() -> None:
    text = f"Odd[] odd\nstd_msgs/Header header\n{BREAK}\nMSG: x/Odd\nint8 a\nint64 b\n{HEADER}"
    with pytest.raises(StampError, match="is no x/msg/T as its definition has it"):
        moved(cdr(text), LITTLE + b"\xff" * 40, SECOND)


def doubled(fields: str, depth: int = 14) -> str:
    """Types of which each has two fields of the next, and a header behind them."""
    parts = [f"{BREAK}\nMSG: x/T{n}\nT{n + 1} a\nT{n + 1} b\n" for n in range(depth)]
    parts.append(f"{BREAK}\nMSG: x/T{depth}\n{fields}\n")
    return f"T0 x\nstd_msgs/Header header\n{''.join(parts)}{HEADER}"


def test_a_type_is_looked_at_once_however_many_fields_have_it(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    made: list[str] = []

    def named(self: Any, name: str, types: Any, within: tuple[str, ...]) -> Any:
        made.append(name)
        return one(self, name, types, within)

    one = stamps._Shapes._named
    monkeypatch.setattr(stamps._Shapes, "_named", named)
    with pytest.raises(StampError, match="is no x/msg/T as its definition has it"):
        moved(cdr(doubled("uint8 v")), LITTLE + bytes(12), SECOND)
    assert len(made) < 50


@pytest.mark.parametrize("fields", ["uint8 a\nuint16 b", "string a", "uint8 a\nstring[0] b"])
def test_a_short_message_of_a_large_type_is_walked_to_its_end_alone(
    monkeypatch: pytest.MonkeyPatch, fields: str
) -> None:
    steps: list[int] = []

    def start(self: Any, at: int, unit: int) -> int:
        steps.append(at)
        return one(self, at, unit)

    one = stamps._Shapes._start
    monkeypatch.setattr(stamps._Shapes, "_start", start)
    with pytest.raises(StampError, match="is no x/msg/T as its definition has it"):
        moved(cdr(doubled(fields)), LITTLE + bytes(12), SECOND)
    assert len(steps) < 50


@pytest.mark.parametrize("array", ["uint16[0]", "string[0]", "std_msgs/Header[0]"])
def test_an_array_of_nothing_moves_no_stamp_behind_it(array: str) -> None:
    definition = cdr(f"uint32 a\n{array} none\nstd_msgs/Header header\n{HEADER}")
    found = moved(definition, LITTLE + bytes(4) + stamped("<", 7), SECOND)
    assert found == LITTLE + bytes(4) + stamped("<", 8)


def test_messages_in_no_known_encoding_are_refused() -> None:
    connection = SimpleNamespace(type="x/T", definition="", encoding="json", schema_encoding="")
    with pytest.raises(StampError, match="messages in json have no known stamps"):
        moved(connection, b"{}", SECOND)
