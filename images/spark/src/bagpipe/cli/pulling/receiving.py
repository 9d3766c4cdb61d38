"""What the sender sends, taken apart: its list, and a tar whose members must be what was asked for.

The tar is read header by header, each of 512 bytes, so that no size in it decides how much is held
here; a member of another name, type or size than the one whose turn it is, is refused.
"""

import hashlib
import json
import tarfile
from collections.abc import Iterator, Sequence
from typing import Protocol

from bagpipe.cli.pulling.entry import MOST_ENTRIES, Entry, PullError, is_fit, unfit

_MOST_LIST_BYTES = 64 << 20
# Of no file system is one larger.
_MOST_FILE_BYTES = 1 << 63
_MOST_DIGITS = 20
_DIGEST_BYTES = 64


class Stream(Protocol):
    """Bytes of a program elsewhere, in order."""

    def exactly(self, count: int) -> bytes:
        """The next bytes. Raises PullError where there are fewer."""

    def some(self, most: int) -> bytes:
        """At least one of the next bytes. Raises PullError where there is none."""


def read_list(stream: Stream) -> tuple[list[Entry], list[str]]:
    """The files that can be copied, and the names of what can't. Raises PullError."""
    digits = b""
    while not digits.endswith(b"\n"):
        digits += stream.exactly(1)
        if len(digits) > _MOST_DIGITS:
            raise PullError(f"the pod wrote what is no list of files: {digits!r}")
    if not digits.strip().isdigit() or int(digits) > _MOST_LIST_BYTES:
        raise PullError(f"the pod wrote what is no list of files: {digits!r}")
    try:
        found = json.loads(stream.exactly(int(digits)))
        entries = [Entry(str(n), int(size), str(mark)) for n, size, mark in found["files"]]
        others = [str(name) for name in found["others"]]
    except (ValueError, TypeError, LookupError, OverflowError, RecursionError) as error:
        raise PullError(f"the pod's list of files can't be read: {error}") from error
    names = [entry.name for entry in entries]
    if len(names) > MOST_ENTRIES or len(set(names)) < len(names):
        raise PullError("the pod's list of files has names twice, or too many")
    if any(not 0 <= entry.size < _MOST_FILE_BYTES for entry in entries):
        raise PullError("the pod's list of files has sizes that are none")
    return [entry for entry in entries if is_fit(entry.name)], others + unfit(names)


def received(
    stream: Stream, wanted: Sequence[Entry], piece_bytes: int
) -> Iterator[tuple[Entry, Iterator[bytes]]]:
    """Each wanted file with its pieces, which must be read to their end before the next one's.

    The pieces raise PullError at their end where the file is not what the sender has read.
    """
    for number, entry in enumerate(wanted):
        yield entry, _pieces(stream, number, entry, piece_bytes)
    if any(stream.exactly(2 * tarfile.BLOCKSIZE)):
        raise PullError("the pod sent more than was asked for")


def _pieces(stream: Stream, number: int, entry: Entry, piece_bytes: int) -> Iterator[bytes]:
    _expect(stream, str(number), entry.size)
    digest, left = hashlib.sha256(), entry.size
    while left:
        piece = stream.some(min(piece_bytes, left))
        digest.update(piece)
        left -= len(piece)
        yield piece
    _padding(stream, entry.size)
    _expect(stream, f"{number}.sha256", _DIGEST_BYTES)
    sent = stream.exactly(_DIGEST_BYTES)
    _padding(stream, _DIGEST_BYTES)
    if sent != digest.hexdigest().encode():
        raise PullError(f"{entry.name} came with other bytes than it was read with: pull it again")


def _expect(stream: Stream, name: str, size: int) -> None:
    block = stream.exactly(tarfile.BLOCKSIZE)
    try:
        member = tarfile.TarInfo.frombuf(block, "utf-8", "surrogateescape")
    except tarfile.TarError as error:
        raise PullError(f"the pod sent what is no tar: {error}") from error
    if (member.name, member.size) != (name, size) or not member.isreg():
        raise PullError(
            f"the pod sent {member.name!r} of {member.size:,} bytes in place of {name} of {size:,}"
        )


def _padding(stream: Stream, size: int) -> None:
    stream.exactly(-size % tarfile.BLOCKSIZE)
