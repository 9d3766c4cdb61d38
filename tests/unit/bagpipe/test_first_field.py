"""Whether messages begin with a header, by definitions of any text: as rosbags reads these."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from bagpipe.definitions import HEADER, types_in
from bagpipe.first_field import begins_with_header

_LINE = "=" * 80
_REST = f"""
{_LINE}
MSG: std_msgs/Header
builtin_interfaces/Time stamp
string frame_id
{_LINE}
MSG: builtin_interfaces/Time
int32 sec
uint32 nanosec
"""


@pytest.mark.parametrize(
    ("text", "begins"),
    [
        ("Header header", True),
        ("std_msgs/Header header\nint8 x", True),
        ("std_msgs/msg/Header h", True),
        ("roslib/Header header", True),
        ("# of a camera\n\n  Header   header  # which one\r\nint8 x", True),
        ("int8 A=1\nstring B = # Header header\nuint8 C  =  3\nHeader header", True),
        ("int8 x\nHeader header", False),
        ("string<=10 name\nHeader header", False),
        ("int32[<=5] x\nHeader header", False),
        ("int32 x 5\nHeader header", False),
        ("Header[] headers", False),
        ("Header[1] headers", False),
        ("other_msgs/Header header", False),
        ("MyHeader header", False),
        ("Header", False),
        ("Header a b", False),
        ("Header header\n---\nHeader header", False),
        ("---\nHeader header", False),
        ("# Header header", False),
        ("=====\nMSG: a/B\nHeader header", False),
        ("", False),
        ("\n" * 100_000, False),
        ("int8 A=1\n" * 100_000, False),
        ("x" * 100_000, False),
        (("x " * 100_000), False),
    ],
)
def test_the_first_line_that_is_a_field_decides(text: str, begins: bool) -> None:
    assert begins_with_header(text, "ros1msg") == begins
    assert begins_with_header(text, "ros2msg") == begins


def test_of_idl_it_is_never_sure() -> None:
    assert not begins_with_header("std_msgs/Header header", "ros2idl")


_LINES = st.sampled_from(
    [
        "", "# Header header", "Header header", "std_msgs/Header header # first", "int8 A=1",
        "string B=Header header", "int8 x", "int8[] y", "string<=3 z",
        "float64[3] w", "string C=x#y", "std_msgs/Header[] many",
        "builtin_interfaces/Time t", "  Header  other ",
    ]
)  # fmt: skip


@given(st.lists(_LINES, max_size=5))
def test_where_it_is_sure_rosbags_reads_a_header_there_and_nowhere_else(lines: list[str]) -> None:
    text = "\n".join(lines)
    try:
        fields = types_in("a/B", text + _REST, "ros2msg")["a/msg/B"][1]
    except Exception:  # noqa: BLE001  two fields of one name, or none at all
        return
    kinds = [kind[1] for _, kind in fields]
    assert begins_with_header(text + _REST, "ros2msg") == (kinds[:1] == [HEADER])
