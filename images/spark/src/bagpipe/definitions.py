"""The types that a recorded definition has, as rosbags describes them."""

from typing import Any

from rosbags.typesys import get_types_from_idl, get_types_from_msg

HEADER = "std_msgs/msg/Header"
# Before ROS Diamondback the header lived in roslib; definitions say "Header" of both.
OLD_HEADER = "roslib/msg/Header"
# Before each part of a definition that has several, in whatever language.
_PARTS = "=" * 80 + "\n"


def full_name(kind: str) -> str:
    """As rosbags calls the type `sensor_msgs/Imu`; one of a service has its folder, too."""
    folder, _, name = kind.rpartition("/")
    return kind if folder.endswith(("/msg", "/action")) else f"{folder}/msg/{name}"


def types_in(kind: str, definition: str, schema_encoding: str) -> dict[str, Any]:
    """All types of a definition by their names. It may raise anything at a text of any kind."""
    if schema_encoding == "ros2idl":
        found: dict[str, Any] = {}
        for part in definition.split(_PARTS):
            # Behind the line with the part's name, where there are several.
            text = part.partition("\n")[2] if part.startswith("IDL: ") else part
            if text.strip():
                found |= get_types_from_idl(text)
        return found
    found = dict(get_types_from_msg(definition, full_name(kind)))
    if OLD_HEADER in found:
        found.setdefault(HEADER, found[OLD_HEADER])
    return found
