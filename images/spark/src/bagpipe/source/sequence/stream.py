"""A sequence of parts as one bag."""

from collections import deque
from typing import Any

import bagpipe
from bagpipe.plan.case import Case
from bagpipe.source.part_reader import MOST_BYTES, PartMessage, PartReader
from bagpipe.storage import Storage
from bagpipe.wire.frames import MAX_PAYLOAD_BYTES
from bagpipe.wire.session import InputFile, SessionError


def sequence_bag(case: Case, storage: Storage) -> "bagpipe.MemoryBag":
    """The case's parts one after the other as one bag, in the case's time.

    A part begins with the latched messages that were in force at its start, if the sequence has
    not sent the same before; those of the first part lie 1 ns before the lead-in, where they count
    as latched and not as played. Raises SessionError and StorageError.
    """
    writer = bagpipe.MemoryBag.writer(byte_budget=MOST_BYTES)
    in_force: dict[tuple[str, str | int], deque[bytes]] = {}
    for number, part in enumerate(case.parts):
        reader = PartReader(part, storage)
        for message in reader.latched():
            known = _known(in_force, reader, message)
            if message.recorded not in known:
                _write(writer, message, message.time if number else max(0, message.time - 1))
                known.append(message.recorded)
        for message in reader.messages():
            _write(writer, message, message.time)
            if message.connection.in_force:
                _known(in_force, reader, message).append(message.recorded)
    return writer.finish()


def _known(
    in_force: dict[tuple[str, str | int], deque[bytes]], reader: PartReader, message: PartMessage
) -> deque[bytes]:
    """What the sequence has sent of the message's publisher that is still in force."""
    publisher = reader.publisher(message.connection)
    return in_force.setdefault(publisher, deque(maxlen=message.connection.in_force))


def sequence_file(case: Case, storage: Storage, name: str) -> InputFile:
    """The case's input: the whole sequence, which is made before the first byte goes out."""
    bag = sequence_bag(case, storage).view()
    pieces = range(0, len(bag), MAX_PAYLOAD_BYTES)
    return InputFile(
        name, len(bag), [], lambda: (bytes(bag[at : at + MAX_PAYLOAD_BYTES]) for at in pieces)
    )


def _write(writer: Any, message: PartMessage, time: int) -> None:
    connection = message.connection
    try:
        writer.write(
            connection.topic,
            time,
            message.data,
            type=connection.type,
            md5sum=connection.md5sum,
            definition=connection.definition,
            callerid=connection.callerid,
            latching=connection.latching,
        )
    except ValueError as error:
        raise SessionError(
            "MemoryBudgetExceeded", f"the sequence does not fit: {error}. Make it shorter"
        ) from error
