"""Values in a stack's texts."""

import pytest
from pydantic import JsonValue

from bagpipe.matrix.faults import MatrixError
from bagpipe.matrix.templates import filled, filled_text

KNOWN: dict[str, JsonValue] = {"threshold": 0.5, "rain": "on", "debug": True, "seed": 3}


@pytest.mark.parametrize(
    ("value", "expected"),
    [
        ("{{ threshold }}", 0.5),
        ("{{threshold}}", 0.5),
        (" {{ debug }} ", True),
        ("rain:={{ rain }}", "rain:=on"),
        ("{{ seed }}-{{ debug }}", "3-true"),
        ("plain", "plain"),
        ("{ threshold }", "{ threshold }"),
        (["{{ seed }}", {"a": "{{ rain }}"}], [3, {"a": "on"}]),
        (7, 7),
        (None, None),
    ],
)
def test_filled(value: JsonValue, expected: object) -> None:
    result = filled(value, KNOWN, "stack.parameters")
    assert result == expected
    assert type(result) is type(expected)


def test_a_text_stays_a_text() -> None:
    assert filled_text("{{ threshold }}", KNOWN, "stack.command[1]") == "0.5"


@pytest.mark.parametrize("text", ["{{ speed }}", "x{{}}", "{{ threshold + 1 }}"])
def test_an_unknown_name_is_refused_with_its_place(text: str) -> None:
    with pytest.raises(MatrixError) as refused:
        filled({"/a": text}, KNOWN, "stack.parameters")
    assert "stack.parameters./a names" in str(refused.value)
    assert "debug, rain, seed, threshold" in str(refused.value)


def test_a_value_is_never_read_as_a_template_again() -> None:
    assert filled_text("{{ a }}", {"a": "{{ b }}", "b": "x"}, "here") == "{{ b }}"
