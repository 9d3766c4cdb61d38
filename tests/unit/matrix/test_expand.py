"""The combinations of a matrix, their rules and their samples."""

import itertools
import math
from collections import Counter

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pydantic import ValidationError

from bagpipe.matrix.expand import Scenario, expand, values_of
from bagpipe.matrix.faults import MatrixError
from bagpipe.matrix.model import Matrix


def matrix(**spec: object) -> Matrix:
    return Matrix.model_validate(spec)


def rows(spec: Matrix) -> list[tuple[object, ...]]:
    return [tuple(s.values.values()) for s in expand(spec).scenarios]


def test_all_combinations_in_the_order_in_which_they_are_written() -> None:
    found = rows(matrix(variables={"rain": ["off", "on"], "speed": [1, 2, 3]}))
    assert found == [("off", 1), ("off", 2), ("off", 3), ("on", 1), ("on", 2), ("on", 3)]


@pytest.mark.parametrize(
    ("variable", "values"),
    [
        ({"from": 5, "to": 15, "step": 5}, [5, 10, 15]),
        (
            {"from": 0, "to": 1, "step": 0.1},
            [0.0, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 1.0],
        ),
        ({"from": 1, "to": 2.5}, [1, 2]),
        ({"from": 0, "to": 1, "step": 1 / 3}, [0.0, 0.333333333333, 0.666666666667, 1.0]),
        (
            {"from": -math.pi, "to": math.pi, "step": math.pi / 2},
            [-3.14159265359, -1.57079632679, 0.0, 1.57079632679, 3.14159265359],
        ),
        ({"from": 10**30, "to": 10**30 + 2}, [10**30, 10**30 + 1, 10**30 + 2]),
        (
            {"from": 1700000000.0, "to": 1700000000.02, "step": 0.004},
            [1700000000 + n / 1000 for n in (0, 4, 8, 12, 16, 20)],
        ),
        ({"from": 10**17, "to": 10**17 + 2}, [10**17, 10**17 + 1, 10**17 + 2]),
        ({"from": -1, "to": -1}, [-1]),
        ({"choices": [{"value": "dry", "weight": 3}, {"value": "rain"}]}, ["dry", "rain"]),
    ],
)
def test_ranges_and_choices_are_values(variable: object, values: list[object]) -> None:
    found = values_of(matrix(variables={"v": variable}).variables["v"])
    assert found == values
    assert [type(v) for v in found] == [type(v) for v in values]


def test_rules_leave_out_with_their_reason() -> None:
    found = expand(
        matrix(
            variables={"threshold": [0.4, 0.6], "rain": ["off", "on"]},
            exclude=[
                {"when": "threshold > 0.5 && rain == 'on'", "because": "never driven"},
                "threshold < 0.1",
            ],
        )
    )
    assert [s.values for s in found.scenarios] == [
        {"threshold": 0.4, "rain": "off"},
        {"threshold": 0.4, "rain": "on"},
        {"threshold": 0.6, "rain": "off"},
    ]
    assert [s.number for s in found.scenarios] == [0, 1, 2]
    [excluded] = found.excluded
    assert (excluded.number, excluded.when, excluded.because) == (
        3,
        "threshold > 0.5 && rain == 'on'",
        "never driven",
    )
    assert found.combinations == 4


def test_an_included_combination_counts_once_and_whatever_the_rules_say() -> None:
    found = expand(
        matrix(
            variables={"a": [1, 2], "b": [1]},
            exclude=["a == 2"],
            include=[{"a": 2, "b": 1}, {"a": 9, "b": 9}, {"a": 1, "b": 1}, {"a": 9, "b": 9}],
        )
    )
    assert [(s.number, s.values) for s in found.scenarios] == [
        (0, {"a": 1, "b": 1}),
        (2, {"a": 2, "b": 1}),
        (3, {"a": 9, "b": 9}),
    ]


def test_of_what_is_included_1_and_1_0_are_one_value_and_1_and_true_are_two() -> None:
    included = [{"x": True}, {"x": 2.0}, {"x": False}, {"x": True}, {"x": 7}, {"x": 7.0}]
    found = expand(matrix(variables={"x": [0, 1, 2]}, include=included))
    values = [(type(s.values["x"]), s.values["x"]) for s in found.scenarios]
    assert values == [(int, 0), (int, 1), (int, 2), (bool, True), (bool, False), (int, 7)]


def test_seeds_repeat_each_combination() -> None:
    found = expand(matrix(variables={"a": [1, 2]}, seeds=3)).scenarios
    assert [(s.number, s.seed) for s in found] == [(0, 0), (0, 1), (0, 2), (1, 0), (1, 1), (1, 2)]


@pytest.mark.parametrize(
    ("rule", "begin", "end"),
    [
        ("a >", "is no expression: ", ""),
        ("b > 1", "names b, which is no variable of the matrix: it has a", ""),
        ("a + 1", "gives 2 and neither true nor false: write a comparison", " (for a=1)"),
        ("a > 'x'", "can't be computed: ", " (for a=1)"),
        ("2 % (a - 1) == 0", "can't be computed: ", " (for a=1)"),
        ("a.first > 1", "can't be computed: ", " (for a=1)"),
    ],
)
def test_a_rule_that_can_t_be_used_is_refused_with_its_place(
    rule: str, begin: str, end: str
) -> None:
    with pytest.raises(MatrixError) as refused:
        expand(matrix(variables={"a": [1]}, exclude=[rule]))
    assert str(refused.value).startswith(f"matrix.exclude[0] ({rule}) {begin}")
    assert str(refused.value).endswith(end)


@pytest.mark.parametrize(
    ("spec", "sentence"),
    [
        ({"variables": {"a": []}}, "a has no value"),
        ({"variables": {"a": [1, 1]}}, "names a value twice"),
        ({"variables": {"a": [1, 1.0]}}, "names a value twice"),
        ({"variables": {"in": [1]}}, "can't name a variable"),
        ({"variables": {"seed": [1]}}, "has a meaning of its own"),
        ({"variables": {"a-b": [1]}}, "can't name a variable"),
        ({"variables": {"a": {"from": 2, "to": 1}}}, "is below from"),
        ({"variables": {"a": {"from": 0, "to": 1, "step": 0}}}, "step above zero"),
        ({"variables": {"a": {"from": 0, "to": 1e9}}}, "larger step"),
        # Each of these floats is two from the next.
        ({"variables": {"a": {"from": 1e16, "to": 1e16 + 8, "step": 1.5}}}, "a larger one"),
        ({"variables": {"a": [float("nan")]}}, "finite"),
        ({"variables": {"a": [1]}, "include": [{"b": 1}]}, "give each of a a value"),
        ({"variables": {}}, "at least 1"),
        ({"variables": {"a": [1]}, "limits": 3}, "Extra inputs"),
    ],
)
def test_a_matrix_that_can_t_be_meant_is_refused(spec: dict[str, object], sentence: str) -> None:
    with pytest.raises(ValidationError) as refused:
        Matrix.model_validate(spec)
    assert sentence in str(refused.value)


def test_too_many_combinations_are_refused_before_they_are_made() -> None:
    spec = matrix(variables={c: list(range(101)) for c in "abc"})
    with pytest.raises(MatrixError, match="1030301 combinations"):
        expand(spec)


def test_nothing_left_is_refused() -> None:
    with pytest.raises(MatrixError, match="leaves no combination"):
        expand(matrix(variables={"a": [1]}, exclude=["true"]))


def test_a_sample_has_each_value_by_its_weight() -> None:
    spec = matrix(
        variables={
            "weather": {"choices": [{"value": "dry", "weight": 3}, {"value": "rain", "weight": 1}]},
            "lane": ["left", "middle", "right"],
            "speed": {"from": 1, "to": 100},
        },
        limit=60,
    )
    found = expand(spec)
    assert len(found.scenarios) == 60
    assert found.sampled_out == 540
    weather = Counter(s.values["weather"] for s in found.scenarios)
    lanes = Counter(s.values["lane"] for s in found.scenarios)
    assert weather == {"dry": 45, "rain": 15}
    assert set(lanes.values()) == {20}
    assert expand(spec) == found
    assert expand(spec.model_copy(update={"sample_seed": 1})) != found


def test_a_large_sample_is_even_too() -> None:
    spec = matrix(variables={c: list(range(20)) for c in "abcd"}, limit=400)
    found = expand(spec).scenarios
    for name in "abcd":
        shares = Counter(s.values[name] for s in found)
        assert len(shares) == 20
        assert set(shares.values()) <= {19, 20, 21}


def test_pairs_that_need_more_than_the_limit_are_refused() -> None:
    with pytest.raises(MatrixError, match="covering every pair of values takes 9"):
        expand(matrix(variables={"a": [1, 2, 3], "b": [1, 2, 3]}, sample="pairwise", limit=5))


columns = st.lists(st.integers(1, 4), min_size=1, max_size=5)


@settings(max_examples=60, deadline=None)
@given(columns, st.sets(st.integers(0, 1023), max_size=200))
def test_pairwise_covers_every_pair_that_is_allowed(sizes: list[int], banned: set[int]) -> None:
    names = [f"v{n}" for n in range(len(sizes))]
    variables = dict(zip(names, [list(range(size)) for size in sizes], strict=True))
    everything = expand(matrix(variables=variables)).scenarios
    allowed = [s for s in everything if s.number not in banned]
    if not allowed:
        return
    rules = [
        " && ".join(f"{n} == {v}" for n, v in s.values.items())
        for s in everything
        if s.number in banned
    ][:100]
    kept = [s for s in everything if s.number not in sorted(banned)[:100] or s in allowed]
    found = expand(matrix(variables=variables, exclude=rules, sample="pairwise")).scenarios
    assert set(map(_pairs_of, kept)) >= {_pairs_of(s) for s in found}
    assert _pairs(found) == _pairs(expand(matrix(variables=variables, exclude=rules)).scenarios)
    assert len(found) <= len(kept)


def _pairs_of(scenario: Scenario) -> frozenset[object]:
    return frozenset(_pairs([scenario]))


def _pairs(scenarios: list[Scenario]) -> set[object]:
    return {
        pair
        for s in scenarios
        for pair in itertools.combinations(sorted(s.values.items()), min(2, len(s.values)))
    }


def test_pairwise_is_much_smaller_than_everything() -> None:
    spec = matrix(variables={c: list(range(5)) for c in "abcdef"}, sample="pairwise")
    assert len(expand(spec).scenarios) <= 45  # of 15,625; 25 is the least that can be


def test_the_barrier_car_of_the_paper() -> None:
    """8 directions x 3 speeds x 3 motions; a car behind that is slower, or beside and turning away,
    never meets the ego car (docs/examples/barrier-car).
    """
    spec = matrix(
        variables={
            "direction": [
                "front", "front-left", "left", "rear-left", "rear", "rear-right", "right",
                "front-right",
            ],
            "speed": ["slower", "equal", "faster"],
            "motion": ["straight", "left", "right"],
        },
        exclude=[
            {"when": "direction.startsWith('rear') && speed == 'slower'", "because": "falls back"},
            {"when": "direction.startsWith('front') && speed == 'faster'", "because": "drives off"},
        ],
    )  # fmt: skip
    found = expand(spec)
    assert found.combinations == 72
    assert Counter(e.because for e in found.excluded) == {"falls back": 9, "drives off": 9}
    assert len(found.scenarios) == 54
