"""The text of a definition in each ROS, with constants as the recording's own text writes them.

The MD5 sum of a type of ROS 1 has the text of its constants, not their values: 0x10 is not 16.
"""

import re
from typing import Any

from rosbags.interfaces import Nodetype
from rosbags.typesys import Stores, get_typestore

from bagpipe.definitions import full_name

# The base types of ROS 1, but for time and duration, which rosbags has as messages.
_INTEGERS = tuple(f"{sign}int{bits}" for sign in ("", "u") for bits in (8, 16, 32, 64))
_OF_ROS_1 = frozenset((*_INTEGERS, "bool", "byte", "char", "float32", "float64", "string"))
_SECTION = re.compile(r"={80}\n(?:MSG: ([\w/]+)[ \t]*\n)?")
_CONSTANT = re.compile(r"^[ \t]*\w+[ \t]+(\w+)[ \t]*=(.*)$", re.MULTILINE)
_QUOTED = re.compile(r"""(["'])((?:(?!\1)[^\\])*)\1""")

# By their type's name and their own.
Texts = dict[tuple[str, str], str]


def constants_in(kind: str, definition: str) -> Texts:
    """What stands behind each constant's sign in a definition in ROS' own form."""
    found: Texts = {}
    kinds_and_texts = [kind, *_SECTION.split(definition)]
    for name, text in zip(kinds_and_texts[::2], kinds_and_texts[1::2], strict=True):
        for constant, value in _CONSTANT.findall(text):
            found[full_name(name or ""), constant] = value.strip()
    return found


def text_of_ros1(name: str, types: dict[str, Any]) -> tuple[str, str]:
    """The whole definition of a type among these and its MD5 sum, as rosbags describes them."""
    return _text(name, types, 1)


def text_of_ros2(name: str, types: dict[str, Any]) -> str:
    """The same in ROS 2, which has no sum."""
    return _text(name, types, 2)[0]


def _text(name: str, types: dict[str, Any], ros: int) -> tuple[str, str]:
    store = get_typestore(Stores.EMPTY)
    store.fielddefs.update(types)
    text, md5sum = store.generate_msgdef(name, ros_version=ros)
    return str(text), str(md5sum)


def constants_of_ros1(name: str, constants: Any, texts: Texts) -> list[Any]:
    """A type's constants with their texts; those of types that ROS 1 does not have are left out.

    Raises ValueError for one of several lines, behind which fields would stand.
    """
    known = [one for one in constants if one[1] in _OF_ROS_1]
    return [
        (each, kind, _in_ros1(kind, value, texts.get((name, each)))) for each, kind, value in known
    ]


def constants_of_ros2(name: str, constants: Any, texts: Texts) -> list[Any]:
    """Those of a type of ROS 1 in ROS 2, where a text has quotes: 1.10 would be a number."""
    return [
        (each, kind, _quoted(texts.get((name, each), str(value))) if kind == "string" else value)
        for each, kind, value in constants
    ]


def _in_ros1(kind: str, value: Any, text: str | None) -> str:
    if len(str(value).splitlines()) > 1:
        raise ValueError(f"the constant {value!r} has several lines")
    if kind == "string":
        found = (str(value) if text is None else _unquoted(text)).strip()
    elif kind == "char" and isinstance(value, str):
        found = str(ord(value))
    elif kind == "bool" and text not in ("0", "1"):
        found = str(bool(value))
    else:
        found = str(value) if text is None else text.partition("#")[0].strip()
    return found


def _unquoted(text: str) -> str:
    quoted = _QUOTED.match(text)
    return text if quoted is None else quoted[2]


def _quoted(text: str) -> str:
    quote = next((each for each in ('"', "'") if each not in text), "")
    return f"{quote}{text}{quote}"


def foreign_to_ros1(fields: Any) -> str | None:
    """The first base type among these fields that ROS 1 does not have."""
    for _, kind in fields:
        node, detail = kind
        while node in (Nodetype.ARRAY, Nodetype.SEQUENCE):
            node, detail = detail[0]
        if node == Nodetype.BASE and detail[0] not in _OF_ROS_1:
            return str(detail[0])
    return None
