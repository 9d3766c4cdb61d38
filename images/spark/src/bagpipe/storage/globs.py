"""Patterns over the names of remote storage, by the rules of fsspec."""

import re
from collections.abc import Callable

_WILDCARD = re.compile(r"[*?\[]")


def is_pattern(path: str) -> bool:
    """Whether a URI or path may name several files."""
    return bool(_WILDCARD.search(path))


def fixed_folder(pattern: str) -> str:
    """The part of a pattern that holds no wildcard, up to and without its last slash."""
    wildcard = _WILDCARD.search(pattern)
    fixed = pattern[: wildcard.start()] if wildcard else pattern
    return fixed.rpartition("/")[0]


def matcher(pattern: str) -> Callable[[str], object]:
    """Whether a whole path matches, as a function: `*` within a folder, `**` across folders."""
    # Slow to load, and of no use where only whole files are read.
    from fsspec.utils import glob_translate  # noqa: PLC0415

    return re.compile(glob_translate(pattern)).match
