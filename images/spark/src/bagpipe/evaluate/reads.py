"""Which numbers of a message an expression reads, so that one that is no number is seen."""

import math
import re
from collections.abc import Iterator
from typing import Any

_QUOTES = "'''|\"\"\"|'|\""
# A comment, or a text with its quotes, in which a backslash escapes nothing after r.
_OPAQUE = re.compile(
    r"//[^\n]*"
    rf"|(?<!\w)(?:[bB]?[rR]|[rR][bB])({_QUOTES})(.*?)\1"
    rf"|({_QUOTES})((?:\\.|(?!\3).)*)\3",
    re.DOTALL,
)
_FIELD = r"\s*\.\s*[A-Za-z_][A-Za-z0-9_]*\b(?!\s*\()"
# Of a text its number stands in the place of what it says.
_ELEMENT = r"\s*\[\s*(?:\d+|'\d+')\s*\]"
_READ = re.compile(rf"(?<!\w)(?<![\w)\]][.])msg\b((?:{_FIELD}|{_ELEMENT})*)")
_PART = re.compile(r"\.\s*([A-Za-z_][A-Za-z0-9_]*)|\[\s*(?:(\d+)|'(\d+)')\s*\]")

Path = tuple[str | int, ...]


def paths_of(text: str) -> list[Path]:
    """The parts of `msg` that an expression names, each up to a method or a computed index."""
    plain, texts = _without_texts(text)
    return list(dict.fromkeys(_path(read[1], texts) for read in _READ.finditer(plain)))


def _without_texts(text: str) -> tuple[str, list[str]]:
    """The expression without comments and what its texts say, which are no part of it."""
    texts: list[str] = []

    def numbered(found: re.Match[str]) -> str:
        if found[0].startswith("//"):
            return " "
        texts.append(found[2] or found[4] or "")
        return f"'{len(texts) - 1}'"

    return _OPAQUE.sub(numbered, text), texts


def _path(read: str, texts: list[str]) -> Path:
    path: list[str | int] = []
    for name, index, number in _PART.findall(read):
        if number and "\\" in texts[int(number)]:
            break  # which field that is, only CEL knows
        path.append(int(index) if index else name or texts[int(number)])
    return tuple(path)


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
