"""An expression of a user's: what it may name, and what it must give."""

import pytest

from bagpipe.expressions import Expression, ExpressionError, UnknownNamesError


def test_it_is_computed_of_the_values_that_it_names() -> None:
    found = Expression.compiled("speed < 3.0 && gear == 'D'", {"speed", "gear", "t"})
    assert found.text == "speed < 3.0 && gear == 'D'"
    assert found.names == {"speed", "gear"}
    assert found.holds({"speed": 2.5, "gear": "D"}) is True
    assert found.holds({"speed": 3.0, "gear": "D"}) is False


def test_unknown_names_are_named_in_their_order() -> None:
    with pytest.raises(UnknownNamesError, match=r"^names a, b$"):
        Expression.compiled("b > a + t", {"t"})


@pytest.mark.parametrize(
    "macro", ["all(x, x > 0)", "exists(x, x > 0)", "exists_one(x, x > 1)", "map(x, x).size() == 2",
              "filter(x, x > 1).size() == 1"]
)  # fmt: skip
def test_names_that_a_macro_binds_are_no_unknown_ones(macro: str) -> None:
    assert Expression.compiled(f"list.{macro}", {"list"}).holds({"list": [1, 2]})


def test_a_function_is_no_macro() -> None:
    with pytest.raises(UnknownNamesError, match=r"^names x$"):
        Expression.compiled("list.size() > x", {"list"})


def test_text_that_does_not_parse_is_refused_in_one_line() -> None:
    with pytest.raises(ExpressionError, match=r"^is no expression: [^\n]+$"):
        Expression.compiled("speed <", {"speed"})


def test_what_can_t_be_computed_is_reported_in_one_line() -> None:
    with pytest.raises(ExpressionError, match=r"^can't be computed: [^\n]+$"):
        Expression.compiled("speed < 'x'", {"speed"}).holds({"speed": 1.0})


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("n % none == 0", "modulo by zero"),
        ("n / none == 0", "division by zero"),
        ("n * n * n * n > 0", "overflow"),
        ("int(1e300) > 0", "overflow"),
    ],
)
def test_what_has_no_result_can_t_be_computed(text: str, words: str) -> None:
    found = Expression.compiled(text, {"n", "none"})
    with pytest.raises(ExpressionError, match=f"^can't be computed: .*{words}"):
        found.holds({"n": 2**40, "none": 0})


@pytest.mark.parametrize(
    ("fault", "words"), [(ValueError("first\nsecond"), "first"), (TypeError(), "TypeError")]
)
def test_of_a_fault_the_first_line_is_shown_and_of_one_without_words_its_kind(
    fault: Exception, words: str
) -> None:
    class Program:
        def execute(self, _: object) -> bool:
            raise fault

    with pytest.raises(ExpressionError) as refused:
        Expression("x", Program(), frozenset()).holds({})  # type: ignore[arg-type]
    assert str(refused.value) == f"can't be computed: {words}"


@pytest.mark.parametrize(("text", "given"), [("a + 1", "2"), ("'yes'", "'yes'"), ("null", "None")])
def test_neither_true_nor_false_is_no_answer(text: str, given: str) -> None:
    sentence = f"gives {given} and neither true nor false: write a comparison"
    with pytest.raises(ExpressionError) as refused:
        Expression.compiled(text, {"a"}).holds({"a": 1})
    assert str(refused.value) == sentence
