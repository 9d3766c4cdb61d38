"""A fragment as the bytes that the agent plays: a recording made of the user's own records."""

from collections.abc import Iterator

from bagpipe.plan.bag_tail import BagError
from bagpipe.plan.case import Case
from bagpipe.plan.framing import framed, framing
from bagpipe.plan.part import Part
from bagpipe.storage import Storage
from bagpipe.wire.frames import MAX_PAYLOAD_BYTES
from bagpipe.wire.session import InputFile, SessionError


def fragment_file(case: Case, storage: Storage) -> InputFile:
    """The case's input (docs/reference/binpipe.md, "The bytes of a fragment")."""
    return _as_stored(case, case.bag_version, storage)


def part_file(part: Part, storage: Storage) -> InputFile:
    """A part of one file of MCAP, as a case of that file alone has it."""
    return _as_stored(part, part.version, storage)


def _as_stored(of: Case | Part, version: str, storage: Storage) -> InputFile:
    sources = of.connections + of.ranges
    head, end = framing(sources)
    ranges = []
    at = len(head)
    for offset, length in sources:
        ranges.append((at, offset, length))
        at += length

    def pieces() -> Iterator[bytes]:
        stored = storage.pieces(of.bag, sources, MAX_PAYLOAD_BYTES, version)
        try:
            yield from framed(sources, stored, of.stated)
        except BagError as error:
            raise SessionError(error.reason, f"{of.bag}: {error}") from error

    return InputFile(of.bag, at + len(end), ranges, pieces)
