"""What a kind of storage has to offer; everything above is the same for all kinds."""

from dataclasses import dataclass
from typing import Protocol


class TransientError(OSError):
    """Asking again may help: a busy server, a broken connection, a deadline that passed."""


class ChangedError(OSError):
    """The file is another one than when it was looked at first."""


class UnfitError(OSError):
    """This storage can't do what results need, today or tomorrow."""


@dataclass(frozen=True)
class Stat:
    """A file's bytes, and a mark that differs as soon as its content does."""

    size: int
    version: str


class Sink(Protocol):
    """A file that is being written and has no name yet."""

    def write(self, data: bytes) -> None:
        """Append. Raises OSError."""

    def commit(self) -> None:
        """Give the whole file its name, over another one of that name. Raises OSError."""

    def abandon(self) -> None:
        """Leave nothing behind; also after a failed commit, and without effect after a good one."""


class Backend(Protocol):
    """One kind of storage. A path is what its URI holds after the scheme.

    A method asks once. It raises TransientError where asking again may help, else
    FileNotFoundError, ChangedError or another OSError with a sentence or an errno. No sentence
    quotes free text of a server or a library: that may hold a credential.
    """

    # How many ranges of one file are asked for at the same time, and the bytes between two
    # ranges up to which one request for both is cheaper than two.
    parallel: int
    gap_bytes: int

    def stat(self, path: str) -> Stat:
        """Size and version of a file; FileNotFoundError where there is none."""

    def read(self, path: str, offset: int, length: int, version: str) -> bytes:
        """At least one byte from `offset`, at most `length`; fewer where the answer broke off.

        Raises ChangedError where the file's version is no longer `version`.
        """

    def glob(self, pattern: str) -> list[str]:
        """The paths of the files that match `*`, `?`, `[...]` and `**`, in any order."""

    def names(self, folder: str) -> list[str]:
        """The names in a folder, in any order; empty where it does not exist."""

    def remove(self, path: str) -> None:
        """Remove a file that may be gone already."""

    def create(self, path: str) -> Sink:
        """Begin a file, making its folders."""

    def put_once(self, path: str, data: bytes, writer: str) -> bool:
        """Create a whole file, making its folders, unless its name is taken: then False.

        `writer` names the caller, the same in all its tries: a file that an earlier try of
        its own created, whose answer was lost or wrong, is True.
        """
