"""The Python side of user logic: records come in on stdin, records go out on stdout.

    from bagpipe import binpipe
    for record in binpipe.read():
        binpipe.write(rotate(record.read()), name=record.name)

This folder needs nothing but Python 3.11 and may be copied beside a program that is not to
depend on Bagpipe. With google-crc32c installed checksums run in hardware; without it, at some
MB/s. What is printed goes to stderr, so that it can't get between the frames. The protocol:
docs/reference/binpipe.md, "User logic on stdin and stdout".

Not for: the executor's end, which is bagpipe.binpiped.
"""

import atexit
import os
import sys
from collections.abc import Iterable, Iterator
from contextlib import AbstractContextManager

from .frames import BinpipeError
from .session import Field, Output, Pipe, Record

__all__ = ["BinpipeError", "Field", "Output", "Pipe", "Record", "create", "flush", "read", "write"]

# The worker sets it, so that even what is printed before the first read() goes to stderr.
_MARK = "BAGPIPE_BINPIPE"
_descriptors: tuple[int, int] | None = None
_pipe: Pipe | None = None


def read() -> Iterator[Record]:
    """The input records, in the order of arrival; a record's bytes come as they are read."""
    return _standard().read()


def write(
    data: bytes | bytearray | memoryview | Iterable[bytes], name: str | None = None, **fields: Field
) -> None:
    """One output record: whole bytes, or an iterable of pieces whose sum is not known yet.

    Without a name it has that of the latest input record. Raises BinpipeError for a field that
    is no str, bytes or integer of 64 bits.
    """
    _standard().write(data, name, **fields)


def create(
    name: str | None = None, size: int | None = None, **fields: Field
) -> AbstractContextManager[Output]:
    """An output record to append to; with a size, exactly that many bytes must come."""
    return _standard().create(name, size, **fields)


def flush() -> None:
    """Hand over what was written so far. Waiting for input and the program's end do it as well."""
    _standard().flush()


def _take_descriptors() -> tuple[int, int]:
    """Keep stdin and stdout for frames; whatever else uses them gets nothing, and stderr."""
    global _descriptors  # noqa: PLW0603  a process has one stdin and one stdout
    if _descriptors is None:
        _descriptors = os.dup(0), os.dup(1)
        nothing = os.open(os.devnull, os.O_RDONLY)
        os.dup2(nothing, 0)
        os.close(nothing)
        os.dup2(2, 1)
    return _descriptors


def _standard() -> Pipe:
    global _pipe  # noqa: PLW0603  a process has one stdin and one stdout
    if _pipe is None:
        _pipe = Pipe(*_take_descriptors())
        atexit.register(_close, _pipe, os.getpid())
    return _pipe


def _close(pipe: Pipe, process: int) -> None:
    # A fork of the program has the frames' descriptors too, but not the right to end the stream.
    if os.getpid() == process:
        pipe.close(getattr(sys, "last_value", None))


if _MARK in os.environ:
    del os.environ[_MARK]
    _take_descriptors()
