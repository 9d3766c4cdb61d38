"""How many steps a backtracking matcher needs for a text, as Python's `re` would need them.

`re` counts nothing, and a clock on a busy machine proves little. This is the same search over the
same parse tree, without its shortcuts: it tries the same alternatives in the same order.
"""

from __future__ import annotations

import functools
import itertools
import re
import sys
from collections.abc import Callable, Iterator

# The parser of `re` itself, which has no public name from 3.11 on.
from re import _constants as sre  # type: ignore[attr-defined]
from re import _parser as parser  # type: ignore[attr-defined]
from typing import Any

Then = Callable[[int], bool]

_REPEATS = {sre.MAX_REPEAT, sre.MIN_REPEAT, sre.POSSESSIVE_REPEAT}
_DEEPEST = 200_000
# No text of these tests takes a linear pattern a tenth of it.
MOST_STEPS = 300_000


class TooManyStepsError(Exception):
    """A text takes more than MOST_STEPS."""


def parsed(pattern: re.Pattern[Any]) -> Any:
    """The parse tree of a pattern."""
    text = pattern.pattern
    source = text.decode("latin-1") if isinstance(text, bytes) else text
    return parser.parse(source, pattern.flags & ~re.UNICODE)


class Steps:
    """Counts the items that are tried while a pattern is looked for all over a text."""

    def __init__(self, pattern: re.Pattern[Any]) -> None:
        self._tree = parsed(pattern)
        self._flags = pattern.flags
        self._text = ""
        self._groups: dict[int, tuple[int, int]] = {}
        self.count = 0
        self.spans: list[tuple[int, int]] = []

    def of(self, text: str) -> int:
        """The steps that `finditer` needs: no other method of a pattern needs more.

        Raises TooManyStepsError.
        """
        before = sys.getrecursionlimit()
        sys.setrecursionlimit(_DEEPEST)
        try:
            return self._all_over(text)
        finally:
            sys.setrecursionlimit(before)  # deep JSON must meet it, and not the end of C's stack

    def _all_over(self, text: str) -> int:
        self._text, self.count, self.spans, at = text, 0, [], 0
        while at <= len(text):
            end = self._end(at)
            if end is not None:
                self.spans.append((at, end))
            at = at + 1 if end is None or end == at else end
        return self.count

    def _end(self, at: int) -> int | None:
        """Where a match that begins at a place ends."""
        self._groups.clear()
        return self._alone(self._tree, at)

    def _sequence(self, items: list[Any], index: int, at: int, then: Then) -> bool:
        if index == len(items):
            return then(at)
        operation, value = items[index]
        return self._item(
            operation, value, at, lambda end: self._sequence(items, index + 1, end, then)
        )

    def _item(self, operation: Any, value: Any, at: int, then: Then) -> bool:
        self.count += 1
        if self.count > MOST_STEPS:
            raise TooManyStepsError
        if operation in _REPEATS:
            return self._repeat(operation, value, at, then)
        if operation is sre.BRANCH:
            return self._branch(value[1], at, then)
        if operation is sre.SUBPATTERN:
            return self._group(value, at, then)
        end = self._behind(operation, value, at)
        return end is not None and then(end)

    def _behind(self, operation: Any, value: Any, at: int) -> int | None:
        """Where an item that matches in one way alone ends; None where it does not match."""
        if operation is sre.ATOMIC_GROUP:
            return self._alone(value, at)
        if operation in {sre.ASSERT, sre.ASSERT_NOT}:
            return at if self._looks(value, at) is (operation is sre.ASSERT) else None
        if operation is sre.AT:
            return at if self._stands(value, at) else None
        if operation is sre.GROUPREF:
            begin, end = self._groups.get(value, (0, 0))
            self.count += end - begin
            part = self._text[begin:end]
            return at + len(part) if self._text.startswith(part, at) else None
        return at + 1 if self._fits(operation, value, at) else None

    def _branch(self, branches: list[Any], at: int, then: Then) -> bool:
        for branch in branches:  # noqa: SIM110 - `any` would take of C's stack for each level
            if self._sequence(list(branch), 0, at, then):
                return True
        return False

    def _group(self, value: Any, at: int, then: Then) -> bool:
        number, _, _, items = value

        def closed(end: int) -> bool:
            before = self._groups.get(number)
            if number is not None:
                self._groups[number] = (at, end)
            if then(end):
                return True
            if number is not None and before is not None:
                self._groups[number] = before
            return False

        return self._sequence(list(items), 0, at, closed)

    def _alone(self, items: Any, at: int) -> int | None:
        """Where the first match of a part ends, whatever comes behind it."""
        ends: list[int] = []

        def at_end(end: int) -> bool:
            ends.append(end)
            return True

        self._sequence(list(items), 0, at, at_end)
        return ends[0] if ends else None

    def _looks(self, value: Any, at: int) -> bool:
        direction, items = value
        begins = [at] if direction > 0 else [at - width for width in _widths(items, at)]
        ends = [self._alone(items, begin) for begin in begins]
        return any(end is not None and (direction > 0 or end == at) for end in ends)

    def _repeat(self, operation: Any, value: Any, at: int, then: Then) -> bool:
        least, most, items = value
        if operation is sre.POSSESSIVE_REPEAT:
            return self._possessive(least, most, items, at, then)
        single = list(items)
        if len(single) == 1 and single[0][0] in {sre.LITERAL, sre.NOT_LITERAL, sre.IN, sre.ANY}:
            return self._run(operation, (least, most, single[0]), at, then)
        return self._again(operation, (least, most, single), at, -1, then)

    def _run(self, operation: Any, repeat: tuple[int, int, Any], at: int, then: Then) -> bool:
        """A repeat of single characters, without a frame for each."""
        least, most, (kind, value) = repeat
        ends = [at]
        while len(ends) <= most and self._fits(kind, value, ends[-1]):
            self.count += 1
            ends.append(ends[-1] + 1)
        choices = ends[least:]
        for end in choices if operation is sre.MIN_REPEAT else reversed(choices):
            self.count += 1
            if then(end):
                return True
        return False

    def _again(
        self, operation: Any, repeat: tuple[int, int, Any], at: int, last: int, then: Then
    ) -> bool:
        least, most, items = repeat
        self.count += 1

        def more() -> bool:
            if most == 0 or at == last:  # a round that takes nothing is the last
                return False
            left = (max(0, least - 1), most if most is sre.MAXREPEAT else most - 1, items)
            return self._sequence(
                items, 0, at, lambda end: self._again(operation, left, end, at, then)
            )

        if least > 0:
            return more()
        if operation is sre.MIN_REPEAT:
            return then(at) or more()
        return more() or then(at)

    def _possessive(self, least: int, most: int, items: Any, at: int, then: Then) -> bool:
        rounds = 0
        while rounds < most:
            end = self._alone(items, at)
            if end is None or end == at:
                break
            at, rounds = end, rounds + 1
        return rounds >= least and then(at)

    def _stands(self, where: Any, at: int) -> bool:
        text, lines = self._text, bool(self._flags & re.MULTILINE)
        if where is sre.AT_BEGINNING:
            return at == 0 or (lines and text[at - 1] == "\n")
        if where is sre.AT_BEGINNING_STRING:
            return at == 0
        if where is sre.AT_END_STRING:
            return at == len(text)
        if where is sre.AT_END:
            last = at == len(text) or (at == len(text) - 1 and text[at] == "\n")
            return last or (lines and text[at] == "\n")
        edge = _is_word(text, at - 1) != _is_word(text, at)
        return edge is (where is sre.AT_BOUNDARY)

    def _fits(self, operation: Any, value: Any, at: int) -> bool:
        if not 0 <= at < len(self._text):
            return False
        letter = self._text[at]
        if operation is sre.LITERAL:
            return letter == chr(value)
        if operation is sre.NOT_LITERAL:
            return letter != chr(value)
        if operation is sre.ANY:
            return letter != "\n" or bool(self._flags & re.DOTALL)
        if operation is sre.IN:
            return is_in(value, letter)
        raise ValueError(f"{operation} is no operation that this matcher knows: add it here")


def is_in(choices: Any, letter: str) -> bool:
    """Whether a set of a parse tree has a letter."""
    wanted = True
    for operation, value in choices:
        if operation is sre.NEGATE:
            wanted = False
        elif _has(operation, value, letter):
            return wanted
    return not wanted


def _has(operation: Any, value: Any, letter: str) -> bool:
    if operation is sre.LITERAL:
        return letter == chr(value)
    if operation is sre.RANGE:
        return bool(value[0] <= ord(letter) <= value[1])
    kinds: dict[Any, bool] = {
        sre.CATEGORY_DIGIT: letter.isdigit(), sre.CATEGORY_NOT_DIGIT: not letter.isdigit(),
        sre.CATEGORY_SPACE: letter.isspace(), sre.CATEGORY_NOT_SPACE: not letter.isspace(),
        sre.CATEGORY_WORD: _is_word(letter, 0), sre.CATEGORY_NOT_WORD: not _is_word(letter, 0),
    }  # fmt: skip
    return bool(kinds[value])


def _is_word(text: str, at: int) -> bool:
    return 0 <= at < len(text) and (text[at].isalnum() or text[at] == "_")


def _widths(items: Any, most: int) -> Iterator[int]:
    least, largest = items.getwidth()
    yield from range(least, min(largest, most) + 1)


# What most sets leave out, or have, so that a text breaks off where a pattern went on.
_LETTERS = "a1A /-_.:{}[]\"'\\@?&=\x00\n"


def words_of(pattern: re.Pattern[Any]) -> dict[str, str]:
    """Texts that parts of a pattern match, each with one that leads to the part."""
    found: dict[str, str] = {}
    _collect(list(parsed(pattern)), "", found)
    return found


def _collect(items: list[Any], context: str, found: dict[str, str]) -> None:
    parts = list(_parts(items))
    samples = ["".join(_sample(each) for each in part) for part in parts]
    for index, part in enumerate(parts):
        lead = context + "".join(samples[:index])
        for inner in _inner(part[0]):
            _collect(list(inner), lead, found)
        for begin in {0, max(0, index - 1), index}:
            word = "".join(samples[begin : index + 1])
            found.setdefault(word, context + "".join(samples[:begin]))
        if part[0][0] is sre.IN:
            for letter in [each for each in _LETTERS if is_in(part[0][1], each)][:4]:
                found.setdefault(letter, lead)


def _parts(items: list[Any]) -> Iterator[list[Any]]:
    """The items, letters that stand side by side as one."""
    for literal, group in itertools.groupby(items, lambda item: item[0] is sre.LITERAL):
        found = list(group)
        yield from [found] if literal else [[item] for item in found]


def _inner(item: Any) -> list[Any]:
    operation, value = item
    if operation in _REPEATS:
        return [value[2]]
    if operation is sre.BRANCH:
        return list(value[1])
    if operation is sre.SUBPATTERN:
        return [value[3]]
    if operation is sre.ATOMIC_GROUP:
        return [value]
    return [value[1]] if operation in {sre.ASSERT, sre.ASSERT_NOT} else []


def _sample(item: Any) -> str:
    """A short text that an item matches; of a repeat what it takes once more than it must."""
    operation, value = item
    if operation is sre.LITERAL:
        return chr(value)
    if operation in {sre.NOT_LITERAL, sre.ANY, sre.IN}:
        return next((each for each in _LETTERS if _letter_fits(operation, value, each)), "")
    if operation in _REPEATS:
        least, most, items = value
        return "".join(_sample(each) for each in items) * int(min(max(1, least), most))
    inner = _inner(item)
    if not inner or operation in {sre.ASSERT, sre.ASSERT_NOT}:
        return ""
    return "".join(_sample(each) for each in inner[0])


def _letter_fits(operation: Any, value: Any, letter: str) -> bool:
    if operation is sre.NOT_LITERAL:
        return letter != chr(value)
    return letter != "\n" if operation is sre.ANY else is_in(value, letter)


def hostile_texts(pattern: re.Pattern[Any]) -> Iterator[Callable[[int], str]]:
    """Makers of texts in which parts of a pattern come so many times, and which then break off, or
    go on with what the pattern does not expect."""
    found = words_of(pattern)
    ends = dict.fromkeys(["", "\x00", "\\", *sorted({word[-1] for word in found if word})[:4]])
    short = [word for word in found if 0 < len(word) <= 2][:6]
    pairs = {a + b: "" for a in short for b in short if a != b}
    for word, context in {**pairs, **found}.items():
        for lead in dict.fromkeys(("", context)) if word else ():
            for end in ends:
                yield functools.partial(_text, lead, word, end)


def _text(lead: str, word: str, end: str, times: int) -> str:
    return lead + word * (times * max(1, 6 // len(word))) + end
