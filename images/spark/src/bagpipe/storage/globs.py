"""Patterns over the names of remote storage, by the rules that Python's glob has for a volume."""

import fnmatch
import re
from collections.abc import Callable, Sequence

_WILDCARD = re.compile(r"[*?\[]")
_ANY_DEPTH = "**"
# Whether a name matches; None where any number of folders does.
_Part = Callable[[str], object] | None


def is_pattern(path: str) -> bool:
    """Whether a URI or path may name several files."""
    return bool(_WILDCARD.search(path))


def fixed_folder(pattern: str) -> str:
    """The part of a pattern that holds no wildcard, up to and without its last slash."""
    wildcard = _WILDCARD.search(pattern)
    fixed = pattern[: wildcard.start()] if wildcard else pattern
    return fixed.rpartition("/")[0]


def is_of_one_folder(pattern: str) -> bool:
    """Whether all that a pattern matches is in the folder before its first wildcard itself."""
    names = pattern.removeprefix(fixed_folder(pattern)).lstrip("/")
    return "/" not in names and names != _ANY_DEPTH


def matcher(pattern: str) -> Callable[[str], bool]:
    """Whether a whole path matches, as a function: `*` within a folder, `**` across folders.

    A name that begins with a dot is matched only where the pattern says so. `**` beside other
    letters is as one star.
    """
    parts = pattern.split("/")
    if parts[-1] == _ANY_DEPTH:
        parts.append("*")
    compiled = [_part(part) for part in parts]
    return lambda path: _matches(compiled, path.split("/"))


def _part(part: str) -> _Part:
    if part == _ANY_DEPTH:
        return None
    match = re.compile(fnmatch.translate(part)).match
    if part.startswith(".") or not is_pattern(part):
        return match
    return lambda name: not name.startswith(".") and match(name)


def _matches(parts: Sequence[_Part], names: Sequence[str]) -> bool:
    """Whether names in their order match parts in theirs, in time of both lengths multiplied."""
    # Which numbers of names are matched by the parts so far.
    reached = {0}
    for part in parts:
        if part is None:
            reached = _below(names, reached)
        else:
            reached = {at + 1 for at in reached if at < len(names) and part(names[at])}
        if not reached:
            return False
    return len(names) in reached


def _below(names: Sequence[str], reached: set[int]) -> set[int]:
    found = set(reached)
    for at in range(min(reached), len(names)):
        if at in found and names[at] and not names[at].startswith("."):
            found.add(at + 1)
    return found
