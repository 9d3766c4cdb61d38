"""What is made for a type is made once, and for no other type."""

from types import SimpleNamespace
from typing import Any

from bagpipe.evaluate.evidence import ForTypes

FIRST = {"type": "a/B", "definition": "int8 x", "schema_encoding": "ros2msg", "encoding": "cdr"}


def test_each_of_what_makes_a_type_makes_another_one() -> None:
    made: list[Any] = []

    def make(connection: Any) -> int:
        made.append(connection.id)
        return len(made)

    kinds = ForTypes(make)
    others = [FIRST | {name: "other"} for name in FIRST]
    connections = [SimpleNamespace(id=n, **kind) for n, kind in enumerate([FIRST, *others, FIRST])]
    assert [kinds.of(each) for each in connections] == [1, 2, 3, 4, 5, 1]
    assert [kinds.of(each) for each in connections] == [1, 2, 3, 4, 5, 1]
    assert made == [0, 1, 2, 3, 4]
