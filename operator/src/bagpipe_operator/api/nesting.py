"""JSON that strangers have nested: read to a bound, so that no depth stops the watch of all jobs.

Python's parser, copies and comparisons recurse, and the API server takes ten thousand levels
(issue 13). What is deeper than the bound becomes null, and the job with it is refused.
"""

import json
import re
from collections.abc import Iterable
from itertools import chain
from typing import Any

# Levels below `spec`. A pod template's deepest field has fifteen.
DEEPEST = 32
# Levels of any text, such as a list of jobs; far enough above the other that what is cut here is
# refused there.
_DEEPEST_OF_TEXT = 4 * DEEPEST
_CONTAINERS = (dict, list)
# A text that breaks off, in the middle of an escape too, is a token to its end: else each of its
# quotes would be looked at as a beginning.
_TOKEN = re.compile(rb'"(?:[^"\\]++|\\(?:.|\Z))*+(?:"|\Z)|[\[{]++|[\]}]++', re.DOTALL)
_TOKEN_OF_TEXT = re.compile(_TOKEN.pattern.decode(), re.DOTALL)


def loads(text: bytes | str) -> Any:
    """The value of a JSON text, whatever its depth; raises ValueError for a text that is none."""
    try:
        return json.loads(text)
    except RecursionError:
        return json.loads(cut(text.encode() if isinstance(text, str) else text))


def cut(text: bytes, most: int = _DEEPEST_OF_TEXT) -> bytes:
    """The text with null in place of each list and object below more than `most` others.

    One pass over the text, in time linear in its length.
    """
    kept: list[bytes] = []
    depth = begin = 0
    for token in _TOKEN.finditer(text):
        first, length = text[token.start()], token.end() - token.start()
        if first in b"[{":
            if depth <= most < depth + length:
                kept += [text[begin : token.start() + most - depth], b"null"]
            depth += length
        elif first in b"]}":
            depth -= length
            if depth <= most < depth + length:
                begin = token.end() - (most - depth)
    if depth <= most:
        kept.append(text[begin:])
    return b"".join(kept)


def end_of(text: str, at: int) -> int:
    """Where the list or object that begins at a place of a JSON text ends, however deep it is."""
    depth = 0
    for token in _TOKEN_OF_TEXT.finditer(text, at):
        first = text[token.start()]
        if first in "[{":
            depth += token.end() - token.start()
        elif first in "]}":
            closed = token.end() - token.start()
            if depth <= closed:
                return token.start() + depth
            depth -= closed
    return len(text)


def bounded(value: Any, most: int = DEEPEST) -> Any:
    """The value itself, in which what lies more than `most` deep has become None."""
    for container in _level(value, most):
        for place, each in list(_places(container)):
            if isinstance(each, dict | list):
                container[place] = None
    return value


def is_deep(value: Any, most: int = DEEPEST) -> bool:
    """Whether the value has `most` levels of lists and objects, or had before it was bounded."""
    return bool(_level(value, most))


def _level(value: Any, number: int) -> list[Any]:
    """The lists and objects of a level; the value itself is on level 1."""
    level = [value] if isinstance(value, dict | list) else []
    for _ in range(number - 1):
        # In C as far as it goes: a job may have half a million values, and two of these passes.
        inner = chain.from_iterable(
            container.values() if isinstance(container, dict) else container for container in level
        )
        level = [each for each in inner if isinstance(each, _CONTAINERS)]
    return level


def _places(container: Any) -> Iterable[tuple[Any, Any]]:
    return container.items() if isinstance(container, dict) else enumerate(container)
