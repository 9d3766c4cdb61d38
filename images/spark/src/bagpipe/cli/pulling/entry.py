"""The files of a results folder, by names that others wrote. Pure."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from fnmatch import fnmatchcase

from bagpipe.cli.places import RefusedError
from bagpipe.report.stored import MANIFEST

# The folder of a pull says with this file whose results it holds.
MARKER = ".bagpipe-pull.jsonl"
MOST_ENTRIES = 200_000
# Storage writes a file under a name that has up to so many bytes more.
_MOST_NAME_BYTES = 255 - len(".") - len(".part") - 25
_MOST_FOLDERS = 8
_MOST_SHOWN = 10


@dataclass(frozen=True)
class Entry:
    """A file below a results folder: `name` with slashes, and a mark that changes with content."""

    name: str
    size: int
    version: str


class PullError(RefusedError):
    """What was to be copied is not here, or not whole."""


def is_fit(name: str) -> bool:
    """Whether a file of that name can be written below a folder, and nowhere else."""
    parts = name.split("/")
    return (
        len(parts) <= _MOST_FOLDERS
        and all(_is_fit_part(part) for part in parts)
        and MARKER not in parts
        and not _is_unfinished(parts[-1])
    )


def unfit(names: Iterable[str]) -> list[str]:
    """The names that are not copied, without those that a writer which died has left."""
    return [name for name in names if not is_fit(name) and not _is_unfinished(name)]


def ordered(entries: Iterable[Entry]) -> list[Entry]:
    """Small files of all first, the manifest last: a folder without one is not whole yet."""
    return sorted(entries, key=lambda e: (e.name == MANIFEST, e.name.count("/"), e.name))


def chosen(entries: Sequence[Entry], only: Sequence[str]) -> list[Entry]:
    """Those that match a pattern, or all without one. Raises PullError for one that none does."""
    if not only:
        return list(entries)
    for pattern in only:
        if not any(fnmatchcase(entry.name, pattern) for entry in entries):
            names = [entry.name for entry in entries]
            more = ", ..." if len(names) > _MOST_SHOWN else ""
            raise PullError(
                f"--only {pattern}: the results have no such file; they have"
                f" {', '.join(names[:_MOST_SHOWN])}{more}"
            )
    return [e for e in entries if any(fnmatchcase(e.name, pattern) for pattern in only)]


def _is_fit_part(part: str) -> bool:
    return (
        part not in ("", ".", "..")
        and part.isprintable()
        and len(part.encode(errors="replace")) <= _MOST_NAME_BYTES
    )


def _is_unfinished(name: str) -> bool:
    """Whether it is what storage calls a file until it is whole."""
    last = name.rpartition("/")[2]
    return last.startswith(".") and last.endswith(".part")
