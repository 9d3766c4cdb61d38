"""Patterns over the files of a mounted volume, by the rules of Python's glob.

Whoever wrote the volume may have put links there by which folders hold each other: `**` goes
through each folder once, by its own name rather than by a link's. Other than Python's, nothing here
takes a folder that can't be read for an empty one: recordings would be lost without a word.
"""

import errno
import fnmatch
import os
import re
from collections.abc import Callable, Iterable, Iterator, Sequence
from pathlib import Path

from bagpipe.storage.globs import is_pattern

_ANY_DEPTH = "**"
# A name of nothing that is there (any more), or of no folder: there is nothing in it.
_NOTHING = {errno.ENOENT, errno.ENOTDIR, errno.ELOOP}
# Of the file system itself, at the root of a volume, and root's alone.
_OF_THE_VOLUME = "lost+found"


def matching(given: str, pattern: str, check: Callable[[Path], None]) -> list[str]:
    """The files below a folder that a pattern matches, each once; also links that lead nowhere.

    `given` is the folder's absolute path, without a slash at its end; `pattern` begins with one.
    `check` raises OSError for a folder that `**` may not be led into, given where it really is. A
    name that begins with a dot is found only where the pattern says so. Raises OSError where a
    folder can't be read.
    """
    groups: list[list[str]] = [[]]
    for part in pattern.split("/")[1:]:
        if part != _ANY_DEPTH:
            groups[-1].append(part)
        elif groups[-1] or len(groups) == 1:  # of several in a row one says the same
            groups.append([])
    first, *others = groups
    found = _named(given, first)
    for group in others:
        below = _below(found, check)
        found = [path for each in below for path in _named(each.rstrip("/"), group or ["*"])]
    return [path for path in dict.fromkeys(found) if _is_file(path)]


def _named(folder: str, parts: Sequence[str]) -> list[str]:
    """What is at a path below a folder, each part of which may be a pattern."""
    paths = [folder]
    for at, part in enumerate(parts):
        if is_pattern(part):
            goes_on = at + 1 < len(parts)
            paths = [path for each in paths for path in _fitting(each, part, goes_on)]
        else:
            paths = [f"{each}/{part}" for each in paths]
    return paths


def _fitting(folder: str, part: str, folders_alone: bool) -> Iterator[str]:
    match = re.compile(fnmatch.translate(part)).match
    for entry in _listed(folder):
        hidden = entry.name.startswith(".") and not part.startswith(".")
        if not hidden and match(entry.name) and not (folders_alone and not _is_folder(entry)):
            yield f"{folder}/{entry.name}"


def _listed(folder: str) -> list[os.DirEntry[str]]:
    """What is in a folder, by name, but for what the file system keeps for itself; nothing where
    there is no folder. Raises OSError.
    """
    try:
        with os.scandir(folder or "/") as entries:
            own = (entry for entry in entries if not _is_of_the_volume(entry))
            return sorted(own, key=lambda entry: entry.name)
    except OSError as error:
        if error.errno in _NOTHING:
            return []
        raise


def _is_of_the_volume(entry: os.DirEntry[str]) -> bool:
    return entry.name == _OF_THE_VOLUME and not os.access(entry.path, os.R_OK | os.X_OK)


def _is_folder(entry: os.DirEntry[str]) -> bool:
    """Whether it is one, or a link to one; a link may lead round and round."""
    try:
        return entry.is_dir()
    except OSError as error:
        if error.errno in _NOTHING:
            return False
        raise


def _is_file(path: str) -> bool:
    """Whether a file is there, or a link that leads to none: who plans it reports that."""
    found = Path(path)
    return found.is_file() or (found.is_symlink() and not found.is_dir())


def once(paths: list[str]) -> list[str]:
    """Each file once: by its own name rather than by that of a link to it, and below its own folder
    rather than below a link to that, where these are among the paths."""
    named: dict[str, tuple[bool, bool, str]] = {}
    for path, real, is_link in _looked_at(paths):
        mine = (is_link, path != real, path)
        named[real] = min(named.get(real, mine), mine)
    kept = {path for _, _, path in named.values()}
    return [path for path in paths if path in kept]


def real_paths(paths: Iterable[str]) -> dict[str, str]:
    """Where each path leads to."""
    return {path: real for path, real, _ in _looked_at(paths)}


def _looked_at(paths: Iterable[str]) -> Iterator[tuple[str, str, bool]]:
    """The paths, where each leads to, and whether it is a link itself."""
    folders: dict[str, str] = {}
    for path in paths:
        folder, _, name = path.rpartition("/")
        if folder not in folders:
            folders[folder] = os.path.realpath(folder or "/")
        is_link = os.path.islink(path)  # noqa: PTH114  a hundred thousand of them
        real = f"{folders[folder].rstrip('/')}/{name}"
        yield path, os.path.realpath(path) if is_link else real, is_link


def _below(bases: Iterable[str], check: Callable[[Path], None]) -> Iterator[str]:
    """The folders among the bases, and those below them: first those that are there themselves."""
    seen: set[tuple[int, int]] = set()
    waiting = [path for path in bases if Path(path).is_dir()]
    for path in waiting:
        check(Path(path).resolve())
    links: list[str] = []
    while waiting or links:
        if not waiting:
            folder = links.pop()
            check(Path(folder).resolve())
            waiting.append(folder)
        folder = waiting.pop()
        try:
            known = Path(folder).stat()
        except FileNotFoundError:  # it went meanwhile
            continue
        if (known.st_dev, known.st_ino) in seen:
            continue
        named = [each for each in _listed(folder) if not each.name.startswith(".")]
        seen.add((known.st_dev, known.st_ino))
        yield folder
        waiting += [each.path for each in named if each.is_dir(follow_symlinks=False)]
        links += [each.path for each in named if each.is_symlink() and _is_folder(each)]
