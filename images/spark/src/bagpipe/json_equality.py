"""Whether two values of JSON are the same: Python has `true` equal to 1."""

from typing import Any


def same(one: Any, other: Any) -> bool:
    """As an API server compares them: 1 and 1.0 are one value, 1 and true are two, at any depth."""
    if isinstance(one, dict) and isinstance(other, dict):
        return one.keys() == other.keys() and all(same(value, other[k]) for k, value in one.items())
    if isinstance(one, list) and isinstance(other, list):
        return len(one) == len(other) and all(map(same, one, other))
    return isinstance(one, bool) == isinstance(other, bool) and bool(one == other)
