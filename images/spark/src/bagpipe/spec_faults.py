"""How a fault that pydantic finds in a job's spec is described."""

from collections.abc import Iterable

# Of a sentence's field and of what is wrong with it: a key of a megabyte may stand in both.
_LONGEST_PLACE, _LONGEST_FAULT = 256, 1024


def sentence(place: Iterable[str | int], fault: str) -> str:
    """`spec.field: what is wrong with it`, of a place below spec; each part is cut to a bound."""
    where = ".".join(["spec", *map(str, place)])
    what = fault.removeprefix("Value error, ")
    return f"{where[:_LONGEST_PLACE]}: {what[:_LONGEST_FAULT]}"
