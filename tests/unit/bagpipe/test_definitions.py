"""Definitions of a recording are untrusted: what is read costs little, and the rest is refused."""

import time

import pytest
from rosbags.interfaces import Nodetype

from bagpipe.definitions import MOST_FIELDS, types_in
from bagpipe.idl import MOST_CHARACTERS, MOST_EXPRESSIONS

NEXT = "\n" + "=" * 80 + "\n"
# What takes the parser minutes takes this at most; what is refused takes milliseconds.
SECONDS = 20


def idl(fields: str = "double data;", constant: str = "") -> str:
    constants = f"module X_Constants {{ const {constant}; }};" if constant else ""
    return f"module p {{ module msg {{ {constants} struct X {{ {fields} }}; }}; }};"


@pytest.mark.parametrize(
    ("definition", "fault"),
    [
        (idl(constant="long A = ((((1))))"), "a constant that is computed"),
        (idl(constant="long A = " + "|".join("1" * 60)), "a constant that is computed"),
        (idl(constant="long A = 1 + 1"), "a constant that is computed"),
        (idl(constant="long A = 0xe+0xe"), "a constant that is computed"),
        (idl(constant="long A = 1 << 31"), "a constant that is computed"),
        (idl("double data[(((1)))];"), "a constant that is computed"),
        (idl("@a(value=((((1))))) double data;"), "a constant that is computed"),
        (idl("sequence<" * 24 + "long" + ">" * 24 + " data;"), "a sequence of sequences"),
        (idl(" ".join(f"long a{n}[1];" for n in range(MOST_EXPRESSIONS + 1))), "1001 constants"),
        (idl("long " + "a" * MOST_CHARACTERS + ";"), "characters, more than 262144"),
        ('"\\' * 100_000, "Could not parse"),
        ("1.1" * 80_000 + "e", "Could not parse"),
        ("/*" * 100_000, "a constant that is computed"),
    ],
)  # fmt: skip
def test_what_takes_the_parser_for_ever_is_refused_at_once(definition: str, fault: str) -> None:
    begun = time.process_time()
    with pytest.raises(Exception, match=fault):
        types_in("p/msg/X", definition, "ros2idl")
    assert time.process_time() - begun < SECONDS


@pytest.mark.parametrize(
    "definition",
    [
        idl('@verbatim (language="comment", text="a (const; x" "b << 1") double data;'),
        idl("// x ((\n @unit(value=1) @key /* ( */ double data;"),
        idl("@a::b double data;", constant="double A = -1e-5"),
        idl(constant='string A = "x - ("'),
        NEXT.join(["IDL: p/msg/X\n" + idl(), "IDL: p/msg/Y\n" + idl().replace("X", "Y")]).lstrip(),
    ],
)
def test_what_rosidl_writes_is_read(definition: str) -> None:
    assert types_in("p/msg/X", definition, "ros2idl")["p/msg/X"][1] == [
        ("data", (Nodetype.BASE, ("float64", 0)))
    ]


@pytest.mark.parametrize(
    ("definition", "fault"),
    [
        ("Foo[30000000] x" + NEXT + "MSG: p/Foo\nbool a", "fixed arrays of 30000000 messages"),
        ("Foo[4000] x\nstring[97] y" + NEXT + "MSG: p/Foo\nbool a", "fixed arrays of 4097"),
        ("Foo[] x" + NEXT + "MSG: p/Foo\n", "X.x is an array of p/msg/Foo, which has no bytes"),
        (
            "Foo[9] x" + NEXT + "MSG: p/Foo\nBar a\nBar[3] b" + NEXT + "MSG: p/Bar\n",
            "p/msg/Foo, which has no bytes",
        ),
    ],
)
@pytest.mark.parametrize("encoding", ["ros1msg", "ros2msg"])
def test_arrays_that_cost_more_than_their_bytes_are_refused(
    definition: str, fault: str, encoding: str
) -> None:
    with pytest.raises(ValueError, match=fault):
        types_in("p/msg/X", definition, encoding)


def doubled(top: str, last: str, depth: int = 40) -> str:
    """Types of which each has two fields of the next: 2^depth of the last one."""
    inner = [f"MSG: p/T{n}\nT{n + 1} a\nT{n + 1} b" for n in range(depth - 1)]
    return NEXT.join([top, *inner, f"MSG: p/T{depth - 1}\n{last}"])


@pytest.mark.parametrize(
    ("definition", "fault"),
    [
        (doubled("T0[] x", ""), "X.x is an array of p/msg/T0, which has no bytes"),
        (doubled("T0[] x", "uint8 structure_needs_at_least_one_member"), "which has no bytes"),
        (doubled("T0 x", ""), "has, with those of its fields' types, more than 100000 fields"),
        (doubled("T0 x", "uint8 v"), f"more than {MOST_FIELDS} fields"),
        (
            doubled("T0 x\nuint8 v", "", 8),
            "X can take 1 B and have 257 values, more than 16 for a byte",
        ),
        ("uint8 v" + "".join(f"\nfloat64[0] x{n}" for n in range(150)), "1 B and have 152 values"),
        ("bool a\n" * 40_000, "it has 280000 characters, more than 262144"),
        ("# " + "a" * MOST_CHARACTERS, "characters, more than"),
    ],
)
@pytest.mark.parametrize("encoding", ["ros1msg", "ros2msg"])
def test_a_short_definition_of_a_large_message_is_refused_at_once(
    definition: str, fault: str, encoding: str
) -> None:
    begun = time.process_time()
    with pytest.raises(ValueError, match=fault):
        types_in("p/msg/X", definition, encoding)
    assert time.process_time() - begun < SECONDS


def test_types_within_types_of_a_robot_are_read() -> None:
    """Twelve levels, an action's empty goals, and 8,000 values that have a byte each."""
    definition = doubled("T0 x\nEmpty goal\nEmpty result\nBool[4000] y", "float64 v\nbool w", 12)
    definition += NEXT + "MSG: p/Empty\n" + NEXT + "MSG: p/Bool\nbool data"
    assert len(types_in("p/msg/X", definition, "ros1msg")) == 15


def test_arrays_of_a_robot_are_read() -> None:
    definition = "Foo[4000] x\nFoo[] y\nfloat64[1000000] z" + NEXT + "MSG: p/Foo\nFoo[] a\nbool b"
    assert len(types_in("p/msg/X", definition, "ros2msg")["p/msg/X"][1]) == 3


@pytest.mark.parametrize(("encoding", "name"), [("ros1msg", "byte"), ("ros2msg", "uint8")])
def test_a_byte_of_ros_2_has_no_sign(encoding: str, name: str) -> None:
    found = types_in("p/msg/X", "byte a\nbyte[3] b\nbyte[] c\nint8 d", encoding)["p/msg/X"][1]
    byte = (Nodetype.BASE, (name, 0))
    assert found == [
        ("a", byte),
        ("b", (Nodetype.ARRAY, (byte, 3))),
        ("c", (Nodetype.SEQUENCE, (byte, 0))),
        ("d", (Nodetype.BASE, ("int8", 0))),
    ]
