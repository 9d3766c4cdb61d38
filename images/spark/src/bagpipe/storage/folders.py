"""Patterns over the files of a mounted volume, by the rules of Python's glob.

Whoever wrote the volume may have put links there by which folders hold each other: `**` goes
through each folder once, by its own name rather than by a link's.
"""

import glob
import os
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path

_ANY_DEPTH = "**"


def matching(pattern: str, check: Callable[[Path], None]) -> list[str]:
    """The files that a pattern of an absolute path matches, each once.

    `check` raises OSError for a folder that `**` may not be led into, given where it really is. A
    name that begins with a dot is found only where the pattern says so.
    """
    groups: list[list[str]] = [[]]
    for part in pattern.split("/"):
        if part != _ANY_DEPTH:
            groups[-1].append(part)
        elif groups[-1] or len(groups) == 1:  # of several in a row one says the same
            groups.append([])
    first, *others = groups
    found = glob.glob("/".join(first) or "/")  # noqa: PTH207  Path.glob wants a relative one
    for group in others:
        names = "/".join(group) or "*"
        below = [f"{glob.escape(each.rstrip('/'))}/{names}" for each in _below(found, check)]
        found = [path for each in below for path in glob.glob(each)]  # noqa: PTH207
    return [path for path in dict.fromkeys(found) if Path(path).is_file()]


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
            if (known.st_dev, known.st_ino) in seen:
                continue
            with os.scandir(folder) as entries:
                named = [entry for entry in entries if not entry.name.startswith(".")]
        except OSError:  # one that may not be read, or is gone: a pattern matches nothing in it
            continue
        seen.add((known.st_dev, known.st_ino))
        yield folder
        waiting += [each.path for each in named if each.is_dir(follow_symlinks=False)]
        links += [each.path for each in named if each.is_symlink() and each.is_dir()]
