"""How a fault that pydantic finds in a job's spec is described."""

from collections.abc import Iterable

# Of a sentence's field and of what is wrong with it: a key of a megabyte may stand in both.
_LONGEST_PLACE, _LONGEST_FAULT = 256, 1024


def sentence(place: Iterable[str | int], fault: str) -> str:
    """`spec.field: what is wrong with it`, of a place below spec: one line of bounded parts."""
    where = ".".join(["spec", *map(str, place)])
    what = fault.removeprefix("Value error, ")
    return f"{_bounded(where, _LONGEST_PLACE)}: {_bounded(what, _LONGEST_FAULT)}"


def _bounded(text: str, longest: int) -> str:
    line = " ".join(text.split())
    return line if len(line) <= longest else line[: longest - 2].rstrip() + " …"
