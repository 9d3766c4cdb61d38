"""What a message begins with, by the first lines of its type's definition.

rosbags' parser may take seconds for a few thousand characters of hostile text, and what it makes of
them half a gigabyte. Here each line is looked at once, and none behind the first field.
"""

import io
import re

from bagpipe.definitions import BETWEEN

# Definitions name the types of their own package and the header without a folder.
_HEADER = re.compile(r"(?:(?:std_msgs|roslib)/(?:msg/)?)?Header\s+[A-Za-z]\w*")
_CONSTANT = re.compile(r"\S+\s+[A-Za-z]\w*\s*=")


def begins_with_header(definition: str, schema_encoding: str) -> bool:
    """Whether it is sure that each message of a type begins with a header.

    Of types in IDL, which may have lines of any form, and of services it is not.
    """
    if schema_encoding == "ros2idl" or f"\n{BETWEEN}" in f"\n{definition}":
        return False
    for line in io.StringIO(definition):
        text = line.partition("#")[0].strip()
        if text and not _CONSTANT.match(text):
            return _HEADER.fullmatch(text) is not None
    return False
