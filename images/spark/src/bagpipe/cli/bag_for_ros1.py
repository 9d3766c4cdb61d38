"""`bagpipe bag convert --messages ros1`: a bag with the messages of ROS 2 as ROS 1 has them."""

import re
from collections.abc import Iterator
from typing import Any, Literal, cast

from bagpipe.cli.bag_here import Elsewhere, Written
from bagpipe.cli.bag_messages import Conversions, rewritten
from bagpipe.cli.bag_reading import BagRefusedError, native
from bagpipe.conversion import Conversion, ConversionError, to_ros1
from bagpipe.encodings import CDR, ROS1
from bagpipe.topic_names import resolve

_COMPRESSIONS = ("none", "lz4", "bz2")
# In nanoseconds: a bag has seconds in 32 bits.
_END_OF_TIME = 10**9 << 32
# As ROS 1's libraries take a name that begins with a slash.
_NAME = re.compile(r"/[\w/]*", re.ASCII)


def for_ros1(file: Elsewhere, target: str, packing: str) -> Written:
    """All messages of a recording, those in CDR as ROS 1 has them; a connection for each of its.

    Raises StorageError, and BagRefusedError where a type or a message can't be one of ROS 1.
    """
    if not target.endswith(".bag"):
        raise BagRefusedError("--messages ros1 writes a bag: let --to end in .bag")
    if packing not in _COMPRESSIONS:
        raise BagRefusedError(f"a bag has no {packing}: --compression can be none, lz4 or bz2")

    def write(
        connections: list[Any],
        conversions: Conversions,
        messages: Iterator[tuple[Any, int, bytes]],
    ) -> tuple[bytes, int]:
        writer = native().writer(compression=cast("Literal['none', 'lz4', 'bz2']", packing))
        declared = {one.id: _declared(one, conversions[one.id]) for one in connections}
        for connection, time, data in messages:
            if time >= _END_OF_TIME:
                raise BagRefusedError(
                    f"{file.uri}: a message of {resolve(connection.topic)} was logged at {time} ns,"
                    " and a bag's time ends in 2106"
                )
            writer.write(resolve(connection.topic), time, data, **declared[connection.id])
        bag = writer.finish()
        return bytes(bag.view()), bag.message_count

    return rewritten(file, "ROS 1", _conversion, write)


def _conversion(connection: Any) -> Conversion | None:
    if not _NAME.fullmatch(resolve(connection.topic)):
        raise ConversionError("no topic of ROS 1 can have this name")
    if connection.encoding == ROS1:
        return None
    if connection.encoding != CDR:
        raise ConversionError(f"its messages are in {connection.encoding}")
    return to_ros1(connection.type, connection.definition, connection.schema_encoding)


def _declared(connection: Any, conversion: Conversion | None) -> dict[str, Any]:
    kind, text, md5sum = connection.type, connection.definition, connection.md5sum
    if conversion is not None:
        # ROS 1 has no folder in a type's name.
        kind = conversion.kind.replace("/msg/", "/")
        text, md5sum = conversion.definition, conversion.md5sum
    return {
        "type": kind,
        "definition": text,
        "md5sum": md5sum,
        "callerid": connection.callerid,
        "latching": connection.latching,
    }
