"""A sequence of parts as one recording."""

from collections import deque
from typing import Any, Protocol

import bagpipe
from bagpipe.encodings import ROS1
from bagpipe.native import native
from bagpipe.plan.case import Case
from bagpipe.source.part_reader import MOST_BYTES, PartMessage, PartReader
from bagpipe.storage import Storage
from bagpipe.wire.frames import payloads
from bagpipe.wire.session import InputFile, SessionError


class _Writer(Protocol):
    def write(self, connection: Any, time: int, data: bytes, /) -> None:
        """Appends a message. Raises ValueError where there is no room for it."""

    def finish(self) -> bytes | memoryview:
        """The whole file."""


class _BagWriter:
    def __init__(self) -> None:
        self._writer = bagpipe.MemoryBag.writer(byte_budget=MOST_BYTES)

    def write(self, connection: Any, time: int, data: bytes) -> None:
        self._writer.write(
            connection.topic,
            time,
            data,
            type=connection.type,
            md5sum=connection.md5sum,
            definition=connection.definition,
            callerid=connection.callerid,
            latching=connection.latching,
        )

    def finish(self) -> memoryview:
        return self._writer.finish().view()


def sequence(case: Case, storage: Storage, encoding: str) -> memoryview:
    """The case's parts one after the other in the case's time: as a bag, or as MCAP in ROS 2.

    A part begins with the latched messages that were in force at its start, if the sequence has
    not sent the same before; those of the first part lie 1 ns before the lead-in, where they count
    as latched and not as played. Raises SessionError and StorageError.
    """
    writer: _Writer = (
        _BagWriter()
        if encoding == ROS1
        else native("MemoryMcapWriter", "writing MCAP")(byte_budget=MOST_BYTES)
    )
    in_force: dict[tuple[str, str | int], deque[bytes]] = {}
    for number, part in enumerate(case.parts):
        reader = PartReader(part, storage, encoding)
        for message in reader.latched():
            known = _known(in_force, reader, message)
            if message.recorded not in known:
                _write(writer, message, message.time if number else max(0, message.time - 1))
                known.append(message.recorded)
        for message in reader.messages():
            _write(writer, message, message.time)
            if message.connection.in_force:
                _known(in_force, reader, message).append(message.recorded)
    try:
        return memoryview(writer.finish())
    except ValueError as error:
        raise _too_long(error) from error


def _known(
    in_force: dict[tuple[str, str | int], deque[bytes]], reader: PartReader, message: PartMessage
) -> deque[bytes]:
    """What the sequence has sent of the message's publisher that is still in force."""
    publisher = reader.publisher(message.connection)
    return in_force.setdefault(publisher, deque(maxlen=message.connection.in_force))


def sequence_file(case: Case, storage: Storage, name: str, encoding: str) -> InputFile:
    """The case's input: the whole sequence, which is made before the first byte goes out."""
    made = sequence(case, storage, encoding)
    return InputFile(name, len(made), [], lambda: payloads(made))


def _write(writer: _Writer, message: PartMessage, time: int) -> None:
    try:
        writer.write(message.connection, time, message.data)
    except ValueError as error:
        raise _too_long(error) from error


def _too_long(error: ValueError) -> SessionError:
    return SessionError(
        "MemoryBudgetExceeded", f"the sequence does not fit: {error}. Make it shorter"
    )
