"""How a fault that pydantic finds in a job's spec is described."""

from collections.abc import Iterable

from bagpipe.one_line import one_line

# Of a sentence's field and of what is wrong with it: a key of a megabyte may stand in both.
_LONGEST_PLACE, _LONGEST_FAULT = 256, 1024


def sentence(place: Iterable[str | int], fault: str) -> str:
    """`spec.field: what is wrong with it`, of a place below spec: one line of bounded parts."""
    where = ".".join(["spec", *map(str, place)])
    what = fault.removeprefix("Value error, ")
    return f"{one_line(where, _LONGEST_PLACE)}: {one_line(what, _LONGEST_FAULT)}"
