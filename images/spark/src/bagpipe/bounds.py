"""How much the open fields of a spec may hold, looked at before anything is made of it.

The CRD takes anything there, a megabyte of wrong values too, and pydantic makes several errors of
each: the operator's memory ended before the first of them was reported.
"""

from collections.abc import Callable
from typing import Any

from pydantic import BaseModel, BeforeValidator, model_validator

# Each value of a list takes eight bytes of job.json at least, and its ConfigMap holds 1 MiB: no
# job that can be run in a cluster has more in one field.
MOST_VALUES = 131_072
# PyYAML, which writes a pod's template, takes twenty microseconds for each.
MOST_VALUES_OF_AFFINITY = 10_000
# Of what has a handful of keys, each of another name is an error of its own.
MOST_KEYS = 64
MOST_PARAMETERS = 1000
_CONTAINERS = (dict, list)


def values_in(value: Any) -> int:
    """How many values lie in the lists and maps of a value, empty ones and keys among them."""
    count, left = 0, [value] if isinstance(value, _CONTAINERS) else []
    while left:
        each = left.pop()
        count += len(each)
        inner = each.values() if isinstance(each, dict) else each
        left += [one for one in inner if one and isinstance(one, _CONTAINERS)]
    return count


def holds_at_most(most: int) -> BeforeValidator:
    """Refuses a field that holds more values than that, before any of them is looked at."""
    return BeforeValidator(_refusing(values_in, most, "values in its lists and maps"))


def has_at_most(most: int = MOST_KEYS) -> BeforeValidator:
    """Refuses a map of more keys than that, before any of them is looked at."""
    return BeforeValidator(_refusing(_keys_of, most, "keys"))


class FewKeys(BaseModel):
    """A model of a map that is open in the CRD, and refuses keys that it does not know."""

    @model_validator(mode="before")
    @classmethod
    def _few_keys(cls, value: Any) -> Any:
        return _FEW(value)


def _keys_of(value: Any) -> int:
    return len(value) if isinstance(value, dict) else 0


def _refusing(count: Callable[[Any], int], most: int, what: str) -> Callable[[Any], Any]:
    def refuse(value: Any) -> Any:
        found = count(value)
        if found > most:
            raise ValueError(f"it has {found} {what}, and may have {most}: leave the others out")
        return value

    return refuse


_FEW = _refusing(_keys_of, MOST_KEYS, "keys")
