"""Which numbers of a message an expression reads, so that one that is no number is seen."""

import math
import re
from collections.abc import Iterator
from typing import Any

_FIELD = r"\s*\.\s*[A-Za-z_][A-Za-z0-9_]*\b(?!\s*\()"
_ELEMENT = r"\s*\[\s*(?:\d+|'[^']*'|\"[^\"]*\")\s*\]"
_READ = re.compile(rf"\bmsg\b((?:{_FIELD}|{_ELEMENT})*)")
_PART = re.compile(r"\.\s*([A-Za-z_][A-Za-z0-9_]*)|\[\s*(?:(\d+)|'([^']*)'|\"([^\"]*)\")\s*\]")

Path = tuple[str | int, ...]


def paths_of(text: str) -> list[Path]:
    """The parts of `msg` that an expression names, each up to a method or a computed index."""
    found: list[Path] = []
    for read in _READ.finditer(text):
        path: list[str | int] = []
        for name, index, single, double in _PART.findall(read[1]):
            path.append(int(index) if index else name or single or double)
        found.append(tuple(path))
    return list(dict.fromkeys(found))


def number_below(message: Any, path: Path) -> float:
    """The first number at or below a path of a message's map that is not finite; else zero."""
    value = message
    for part in path:
        try:
            value = value[part]
        except (LookupError, TypeError):
            return 0.0
    return next(_odd(value), 0.0)


def _odd(value: Any) -> Iterator[float]:
    if isinstance(value, float):
        if not math.isfinite(value):
            yield value
    elif isinstance(value, dict):
        for part in value.values():
            yield from _odd(part)
    elif isinstance(value, list):
        for part in value:
            yield from _odd(part)
