"""`bagpipe bag convert --messages`: the messages of a recording as the other ROS has them."""

from collections.abc import Callable, Iterator
from typing import Any

from bagpipe.cli.bag_here import Elsewhere, Written
from bagpipe.cli.bag_reading import BagRefusedError
from bagpipe.conversion import Conversion, ConversionError
from bagpipe.recording_format import in_memory
from bagpipe.topic_names import resolve

# By the connection's number; of one whose messages stay as they are none.
Conversions = dict[int, Conversion | None]
# Takes a recording's connections with their conversions, and its messages; gives a file's bytes.
Write = Callable[[list[Any], Conversions, Iterator[tuple[Any, int, bytes]]], tuple[bytes, int]]


def rewritten(
    file: Elsewhere, ros: str, conversion: Callable[[Any], Conversion | None], write: Write
) -> Written:
    """All messages of a recording, each by the conversion of its connection.

    Raises StorageError, and BagRefusedError where a type or a message has no place in that ROS.
    """
    as_mcap = file.converted("all.mcap", "none")
    try:
        recording = in_memory(as_mcap.data, decompressed_bytes=2 * file.budget)
        conversions = _conversions(file.uri, recording.connections, ros, conversion)
        messages = _converted(file.uri, recording, conversions)
        data, count = write(recording.connections, conversions, messages)
    except ValueError as error:
        raise BagRefusedError(f"{file.uri}: {error}") from error
    added = sorted({name for each in conversions.values() if each for name in each.added})
    return Written(data, count, as_mcap.damage, tuple(added))


def _conversions(
    uri: str, connections: list[Any], ros: str, conversion: Callable[[Any], Conversion | None]
) -> Conversions:
    """What can't be converted is named at once."""
    found: Conversions = {}
    refused: dict[str, str] = {}
    for one in connections:
        try:
            found[one.id] = conversion(one)
        except ConversionError as error:
            refused[resolve(one.topic)] = str(error)
    if refused:
        why = "; ".join(f"{topic}: {text}" for topic, text in sorted(refused.items()))
        raise BagRefusedError(
            f"{uri} has topics that {ros} can't have: {why}. `bagpipe bag slice --topic` writes a"
            " recording of the others"
        )
    return found


def _converted(
    uri: str, recording: Any, conversions: Conversions
) -> Iterator[tuple[Any, int, bytes]]:
    for connection, time, raw in recording.messages():
        conversion = conversions[connection.id]
        try:
            data = bytes(raw) if conversion is None else conversion.convert(raw)
        except ConversionError as error:
            raise BagRefusedError(
                f"{uri}: the message of {resolve(connection.topic)} at {time} ns: {error}. `bagpipe"
                " bag slice --topic` writes a recording of the other topics"
            ) from error
        yield connection, time, data
