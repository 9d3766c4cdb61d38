"""Which of many versions in order is the first bad one, by as few looks as there can be. Pure."""

from collections.abc import Mapping
from dataclasses import dataclass

from bagpipe.cli.judged_step import Word

# What each version that was looked at is; versions are numbered from the oldest.
Words = Mapping[int, Word]


@dataclass(frozen=True)
class Found:
    """The newest `good` one, and those of which one is the first bad: all up to the last of them.

    `bad` has one number where each of its predecessor and itself was judged.
    """

    good: int
    bad: tuple[int, ...]


def wrong_end(count: int, words: Words) -> str:
    """Why there is nothing to look for between the two ends; empty where there is, or may be."""
    first, last = words.get(0), words.get(count - 1)
    if first == "bad":
        return "the good end fails as well: the fault is older, so give an older one"
    if first == "unknown":
        return "the good end can't be judged, so that nothing after it can be called worse"
    if last == "good":
        return "the bad end passes: there is nothing to look for, or the case flakes"
    if last == "unknown":
        return "the bad end can't be judged, so that nothing before it can be called better"
    return ""


def next_look(count: int, words: Words) -> int | None:
    """The version to look at; None where no further look says more.

    Both ends come first. Then it is the middle between the newest good and the oldest bad one that
    follows it, or where that can't be judged the nearest one to it.
    """
    for end in (0, count - 1):
        if end not in words:
            return end
    if wrong_end(count, words):
        return None
    good, bad = _between(count, words)
    middle = (good + bad) // 2
    left = [number for number in range(good + 1, bad) if number not in words]
    return min(left, key=lambda number: (abs(number - middle), number), default=None)


def found(count: int, words: Words) -> Found:
    """What is known when `next_look` has no more to ask, and no end is wrong."""
    good, bad = _between(count, words)
    return Found(good, tuple(range(good + 1, bad + 1)))


def _between(count: int, words: Words) -> tuple[int, int]:
    bad = min(number for number in range(count) if words.get(number) == "bad")
    return max(number for number in range(bad) if words.get(number) == "good"), bad
