"""Which numbers of a message an expression reads, so that one that is no number is seen."""

import math
import re
from collections.abc import Callable, Iterator
from typing import Any

from bagpipe.evaluate.fields import single

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
# Of a number, true or false, or a text, of which no method follows.
_LITERAL = r"(?P<{0}>-?[.]?\d[\w.]*|(?:true|false)\b|'\d+'(?!\s*[.\[]))"
_EQUAL = r"\s*[!=]=\s*"
_COMPARED = re.compile(
    rf"{_READ.pattern}{_EQUAL}{_LITERAL.format('right')}"
    rf"|(?<![\w.]){_LITERAL.format('left')}{_EQUAL}{_READ.pattern}(?!\s*[.\[(])"
)
# What is in brackets, and what a relation reaches no further back than.
_CLOSED = re.compile(r"[(\[{][^()\[\]{}]*[)\]}]")
_BEGIN = re.compile(r"[(\[{,?:]|&&|\|\|")
_RELATION = re.compile(r"[<>=]|\bin\b")
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


def never_equal(text: str, message: Any, in_single: Callable[[Path], bool]) -> str:
    """A sentence where a field is compared with a literal that no value of its type equals: CEL
    then gives an answer for every message, and it is always the same one. `in_single` says whether
    the number at a path has 32 bits.
    """
    plain, texts = _without_texts(text)
    for found in _COMPARED.finditer(plain):
        if _ends_a_relation(plain[: found.start()]):
            continue
        parts = found[1] if found["right"] else found[4]
        literal, path = found["right"] or found["left"], _path(parts, texts)
        other = _type_of_literal(literal)
        value = _type_of(_at(message, path))
        if value and value != other:
            return f"compares msg{parts.strip()}, which is {value}, with {other}: never equal"
        if value == "a number" and _no_single(literal) and in_single(path):
            return (
                f"compares msg{parts.strip()}, which has 32 bits, with {literal}, which these"
                " don't have: never equal"
            )
    return ""


def _ends_a_relation(text: str) -> bool:
    """Whether what follows is a relation's right side: all of that is compared with the next one,
    as in a > 2 == b.
    """
    while (shorter := _CLOSED.sub("0", text)) != text:
        text = shorter
    return _RELATION.search(_BEGIN.split(text)[-1]) is not None


def _no_single(literal: str) -> bool:
    """Whether a number is a fraction that no field of 32 bits has."""
    try:
        return single(float(literal)) != float(literal)
    except ValueError:
        return False  # as hexadecimal digits


def _type_of(value: Any) -> str:
    if isinstance(value, bool):
        return "true or false"
    if isinstance(value, int | float):
        return "a number"
    return "a text" if isinstance(value, str) else ""


def _type_of_literal(text: str) -> str:
    if text[0] == "'":
        return "a text"
    return "true or false" if text in {"true", "false"} else "a number"


def number_below(message: Any, path: Path) -> float:
    """The first number at or below a path of a message's map that is not finite; else zero."""
    return next(_odd(_at(message, path)), 0.0)


def _at(message: Any, path: Path) -> Any:
    """What is at a path of a message's map; None where nothing is."""
    value = message
    for part in path:
        try:
            value = value[part]
        except (LookupError, TypeError):
            return None
    return value


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
