"""Values in a stack's texts."""

import pytest
from pydantic import JsonValue

from bagpipe.matrix.faults import MatrixError
from bagpipe.matrix.templates import filled, filled_text, has_template

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


@pytest.mark.parametrize("blank", [" ", "\t", "\n", "\u2003"])
def test_a_name_has_no_blanks_of_any_kind_around_it(blank: str) -> None:
    assert filled(f"{{{{{blank * 3}seed{blank}}}}}", KNOWN, "stack.parameters") == 3
    assert filled_text(f"a {{{{{blank}seed{blank * 2}}}}} b", KNOWN, "stack.parameters") == "a 3 b"
    with pytest.raises(MatrixError, match=r"names \{\{  \}\}, which is no variable"):
        filled(f"{{{{{blank * 5}}}}}", KNOWN, "stack.parameters")


@pytest.mark.parametrize(
    "hostile", ["{{" + " " * 200_000, "{{ x" * 50_000, "{{ x" + " " * 200_000 + "}"]
)
def test_whoever_looks_for_a_template_is_done_at_once(hostile: str) -> None:
    """With blanks in the pattern the first took hours, in the operator's one thread."""
    assert not has_template([hostile])
    assert filled_text(hostile, KNOWN, "stack.parameters") == hostile
