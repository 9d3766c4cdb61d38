"""No depth of what a tenant writes stops the operator."""

import json
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from bagpipe_operator.api.nesting import DEEPEST, bounded, cut, is_deep, loads

VALUES = st.recursive(
    st.none()
    | st.booleans()
    | st.integers()
    | st.text()
    | st.sampled_from(['"', "[{", "]\\", "}"]),
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(st.text(), inner, max_size=4),
    max_leaves=30,
)


def nested(levels: int, of: str = "[") -> str:
    """So many lists, or objects, in each other."""
    if of == "[":
        return "[" * levels + "]" * levels
    return '{"a":' * levels + "1" + "}" * levels


def depth_of(value: Any) -> int:
    if not isinstance(value, dict | list):
        return 0
    inner = value.values() if isinstance(value, dict) else value
    return 1 + max(map(depth_of, inner), default=0)


def cut_by_hand(value: Any, most: int) -> Any:
    """What `cut` does, by a recursion that only a test may afford."""
    if not isinstance(value, dict | list):
        return value
    if most == 0:
        return None
    if isinstance(value, dict):
        return {key: cut_by_hand(each, most - 1) for key, each in value.items()}
    return [cut_by_hand(each, most - 1) for each in value]


@given(VALUES, st.integers(1, 6), st.sampled_from([None, 2]))
def test_a_text_is_cut_where_it_is_too_deep_and_nowhere_else(
    value: Any, most: int, indent: int | None
) -> None:
    for ascii_only in (True, False):
        text = json.dumps(value, indent=indent, ensure_ascii=ascii_only).encode()
        assert json.loads(cut(text, most)) == cut_by_hand(value, most)


@given(VALUES, st.integers(1, 6))
def test_a_value_is_cut_likewise_and_known_to_have_been_deep(value: Any, most: int) -> None:
    wrapped = {"spec": value}
    expected, depth = cut_by_hand(wrapped, most), depth_of(wrapped)
    assert is_deep(wrapped, most) == (depth >= most)
    assert bounded(wrapped, most) == expected
    assert is_deep(wrapped, most) == (depth >= most)


@pytest.mark.parametrize("of", ["[", "{"])
@pytest.mark.parametrize("levels", [1_500, 10_000, 100_000])
def test_what_python_can_t_read_is_read_to_a_bound_and_refused(levels: int, of: str) -> None:
    text = f'{{"items": [{{"spec": {{"x": {nested(levels, of)}}}}}, {{"spec": {{"y": 1}}}}]}}'
    with pytest.raises(RecursionError):
        json.loads(text)
    deep, shallow = loads(text)["items"]
    assert is_deep(deep["spec"])
    assert depth_of(bounded(deep["spec"])) == DEEPEST
    assert is_deep(deep["spec"])
    assert shallow == {"spec": {"y": 1}}
    assert not is_deep(shallow["spec"])


def test_what_is_no_json_is_refused_as_ever() -> None:
    for text in (b"", b"[", b"<html>", b'{"a":', b"[" * 5000):
        with pytest.raises(ValueError):  # noqa: PT011  json's own, whose words are not ours
            loads(text)


def test_a_text_that_ends_within_a_string_is_cut_in_one_pass() -> None:
    """Four times as long took sixteen times as long; this would be hours."""
    text = b"[" * 400 + b'"' + b'\\"' * 750_000
    assert cut(text) == b"[" * 128 + b"null"
