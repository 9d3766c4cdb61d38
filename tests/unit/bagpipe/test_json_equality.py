"""Which values of JSON are one: as for an API server, and not as for Python."""

from typing import Any

import pytest

from bagpipe.json_equality import same


@pytest.mark.parametrize(
    ("one", "other", "equal"),
    [
        (1, 1.0, True),
        (1, True, False),
        (0, False, False),
        (True, True, True),
        (None, False, False),
        ("1", 1, False),
        ({"a": [1, {"b": 0}]}, {"a": [1.0, {"b": 0}]}, True),
        ({"a": [1, {"b": 0}]}, {"a": [1, {"b": False}]}, False),
        ({"a": 1}, {"a": 1, "b": None}, False),
        ([1, 2], [1], False),
        ([], {}, False),
    ],
)
def test_what_is_one_value(one: Any, other: Any, equal: bool) -> None:
    assert same(one, other) == same(other, one) == equal
