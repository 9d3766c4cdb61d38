"""The files that a program of the exec engine gives back, kept under one attempt's own names.

Their names come from inside the user's container, so a name that is no plain file name is
refused here, whatever the agent has let through.
"""

import contextlib
import posixpath
from collections.abc import Iterator

from bagpipe.storage import NewFile, Storage
from bagpipe.wire.session import SessionError

_MAX_FILES = 1000
_MAX_NAME_BYTES = 255
# The agent's own word for it: the program is at fault, and another attempt would not help.
REASON = "StackProtocolError"


class Outputs:
    """Receives files one after the other; each appears whole under its name, or not at all."""

    def __init__(self, storage: Storage, results: str, prefix: str) -> None:
        self._storage = storage
        self._results = results
        self._prefix = prefix
        self._current = contextlib.ExitStack()
        self._left: int | None = 0
        self.names: list[str] = []

    def begin(self, name: str, size: int | None) -> "Outputs":
        """Take the next file, of `size` bytes, or of as many as come.

        Raises SessionError for a name of no use.
        """
        self.finish()
        stored = f"{self._prefix}.{_plain(name)}"
        if stored in self.names or len(self.names) == _MAX_FILES:
            raise SessionError(
                REASON, f"{name!r} came twice, or as one of more than {_MAX_FILES} files"
            )
        file = self._storage.create(posixpath.join(self._results, stored))
        self._file: NewFile = self._current.enter_context(file)
        self._left = size
        self.names.append(stored)
        return self

    def write(self, data: bytes, /) -> None:
        """Append to the file that was begun last. Raises StorageError."""
        if self._left is not None:
            self._left -= len(data)
        self._file.write(data)

    def finish(self) -> None:
        """Put the last file in its place. Raises SessionError where bytes are missing."""
        if self._left:
            raise SessionError(REASON, f"{self.names[-1]} has not the size that was announced")
        self._current.close()

    def discard(self, error: BaseException) -> None:
        """Leave nothing behind."""
        # An open file vanishes because its block sees the error.
        with contextlib.suppress(type(error)), self._current:
            raise error
        for name in self.names:
            self._storage.remove(posixpath.join(self._results, name))


@contextlib.contextmanager
def collected(storage: Storage, results: str, prefix: str) -> Iterator[Outputs]:
    """The outputs of one attempt, named `prefix` and their own name below `results`.

    They stay when the block ends well; else none does.
    """
    outputs = Outputs(storage, results, prefix)
    try:
        yield outputs
        outputs.finish()
    except BaseException as error:
        outputs.discard(error)
        raise


def _plain(name: str) -> str:
    plain = (
        0 < len(name.encode()) <= _MAX_NAME_BYTES
        and name not in {".", ".."}
        and not any(letter in "/\\" or not letter.isprintable() for letter in name)
    )
    if not plain:
        raise SessionError(REASON, f"the program named a file {name[:100]!r}: write a plain name")
    return name
