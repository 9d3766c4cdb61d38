"""Definitions in IDL, without what takes their parser longer than they are worth.

rosbags' parser tries an expression's alternatives again and again: each pair of parentheses takes
64 times as long, each sequence in a sequence twice. A recording is untrusted, and whoever reads a
definition has no deadline, so what is not needed is left out before, and the rest is bounded.
"""

import re
from typing import Any

from rosbags.typesys import get_types_from_idl

# A constant or a bound takes the parser some 10 ms, all else a tenth of a millisecond a line.
MOST_CHARACTERS, MOST_EXPRESSIONS = 1 << 18, 1000

# Before each part of a definition that has several, whose first line has its name.
_PARTS, _NAME = "=" * 80 + "\n", "IDL: "
_WORDS = re.compile(r'"(?:[^"\\\n]|\\.)*"?|//[^\n]*|/\*(?:.*?\*/|.*)', re.DOTALL)
_ANNOTATION = re.compile(r"@\w[\w:]*\s*(?:\([^()]*\))?")
_EXPONENT = re.compile(r"(?<![\d.])(\d[\d.]*+[eE])[+-](?=\d)")
_COMPUTED = re.compile(r"""[()*/%^|&~]|<<|[\w."']\s*[+-]""")
_NESTED = re.compile(r"\bsequence\s*<\s*sequence\b")
_EXPRESSION = re.compile(r"\bconst\b|\[|<[^<>]*\d")


def types_in_idl(definition: str) -> dict[str, Any]:
    """The types of a definition; raises ValueError for what is not read, or rosbags' faults.

    Comments and annotations are left out. A constant or a bound has to be one literal or one name,
    as rosidl writes them.
    """
    texts: list[str] = []
    parts = [_plain(part, texts) for part in definition.split(_PARTS)]
    _refuse_costly("\n".join(parts))
    found: dict[str, Any] = {}
    for part in filter(str.strip, parts):
        found |= get_types_from_idl(part)
    return {name: (_with(texts, constants), fields) for name, (constants, fields) in found.items()}


def _plain(part: str, texts: list[str]) -> str:
    """Without what is not needed; a text is its number among `texts`, to which it is added."""

    def left(word: re.Match[str]) -> str:
        if not word[0].startswith('"'):
            return " "  # as a comment divides words
        texts.append(word[0][1:].removesuffix('"'))
        return f'"{len(texts) - 1}"'

    text = part.partition("\n")[2] if part.startswith(_NAME) else part
    return _ANNOTATION.sub(" ", _WORDS.sub(left, text))


def _with(texts: list[str], constants: Any) -> list[Any]:
    places = {str(number): text for number, text in enumerate(texts)}
    return [
        (name, kind, places.get(value, value) if kind in ("string", "wstring") else value)
        for name, kind, value in constants
    ]


def _refuse_costly(text: str) -> None:
    if len(text) > MOST_CHARACTERS:
        raise ValueError(f"it has {len(text)} characters, more than {MOST_CHARACTERS}")
    if (computed := _COMPUTED.search(_EXPONENT.sub(r"\1", text))) is not None:
        raise ValueError(f"it has a constant that is computed ({computed[0]}): write its value")
    if _NESTED.search(text):
        raise ValueError("it has a sequence of sequences, which ROS 2 has not")
    if (expressions := len(_EXPRESSION.findall(text))) > MOST_EXPRESSIONS:
        raise ValueError(f"it has {expressions} constants and bounds, more than {MOST_EXPRESSIONS}")
