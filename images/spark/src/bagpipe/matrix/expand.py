"""The combinations of a matrix: all of them, less what rules exclude, or a sample that covers them.

Deterministic: the same matrix gives the same scenarios in the same order on every machine.
"""

import itertools
import math
from collections.abc import Iterator
from dataclasses import dataclass, field
from decimal import Decimal

from bagpipe.matrix.faults import MatrixError
from bagpipe.matrix.model import Choices, Matrix, Scalar, Span, Variable, one_value
from bagpipe.matrix.rules import Rules
from bagpipe.matrix.sampling import pairwise, stratified

# Beyond this nobody reads a plan, and the driver would spend its memory on it.
MOST_COMBINATIONS = 1_000_000
MOST_SCENARIOS = 1_000_000
# Of a step: what is as near to a range's end as this is its end.
_NEAR = Decimal("1e-9")

Values = dict[str, Scalar]


@dataclass(frozen=True)
class Scenario:
    """One combination; `number` counts all combinations, with those that are left out.

    `seed` counts the repetitions with another random seed, from 0.
    """

    number: int
    values: Values = field(hash=False)
    seed: int = 0


@dataclass(frozen=True)
class Excluded:
    """A combination that a rule left out."""

    number: int
    values: Values
    when: str
    because: str


@dataclass(frozen=True)
class Expansion:
    """What will run, and what was left out and why.

    `sampled_out` counts allowed combinations that the sample does not have.
    """

    scenarios: list[Scenario]
    excluded: list[Excluded]
    combinations: int
    sampled_out: int = 0


def values_of(variable: Variable) -> list[Scalar]:
    """The values that a variable takes, in the order in which they are written."""
    if isinstance(variable, Choices):
        return [choice.value for choice in variable.choices]
    if isinstance(variable, Span):
        return _numbers(variable)
    return list(variable)


def _numbers(span: Span) -> list[Scalar]:
    """Integers stay integers; all else is reckoned in decimals, as it is written: steps of 0.1 have
    no exact floats. A third has no exact decimals either: what is as near to a number of twelve
    digits, or to 0, as makes no difference is that.
    """
    if isinstance(span.first, int) and isinstance(span.step, int):
        return list(range(span.first, math.floor(span.last) + 1, span.step))
    first, last, step = (Decimal(repr(n)) for n in (span.first, span.last, span.step))
    near = _NEAR * step
    count = int((last + near - first) / step) + 1
    return [_float(first + index * step, near) for index in range(count)]


def _float(number: Decimal, near: Decimal) -> float:
    short = Decimal(f"{number:.12g}") if abs(number) > near else Decimal(0)
    return float(short if abs(short - number) <= near else number)


def expand(matrix: Matrix) -> Expansion:
    """All scenarios of a matrix. Raises MatrixError."""
    names = list(matrix.variables)
    values = {name: values_of(variable) for name, variable in matrix.variables.items()}
    total = math.prod(len(v) for v in values.values())
    if total > MOST_COMBINATIONS:
        raise MatrixError(
            f"matrix.variables have {total} combinations, and may have {MOST_COMBINATIONS}: take"
            " fewer values"
        )
    rules = Rules.compiled(matrix.exclude, values)
    allowed, excluded = _split(rules, names, values)
    allowed += _included(matrix, rules, names, values, total)
    if not allowed:
        raise MatrixError("matrix.exclude leaves no combination: loosen a rule")
    chosen = _chosen(matrix, allowed, values)
    if len(chosen) * matrix.seeds > MOST_SCENARIOS:
        raise MatrixError(f"the matrix gives more than {MOST_SCENARIOS} scenarios: write a limit")
    scenarios = [
        Scenario(scenario.number, scenario.values, seed)
        for scenario in chosen
        for seed in range(matrix.seeds)
    ]
    return Expansion(scenarios, excluded, total, len(allowed) - len(chosen))


def _split(
    rules: Rules, names: list[str], values: dict[str, list[Scalar]]
) -> tuple[list[Scenario], list[Excluded]]:
    allowed: list[Scenario] = []
    excluded: list[Excluded] = []
    for number, combination in enumerate(_combinations(names, values)):
        rule = rules.excluding(combination)
        if rule is None:
            allowed.append(Scenario(number, combination))
        else:
            excluded.append(Excluded(number, combination, rule.when.text, rule.because))
    return allowed, excluded


def _combinations(names: list[str], values: dict[str, list[Scalar]]) -> Iterator[Values]:
    for row in itertools.product(*(values[name] for name in names)):
        yield dict(zip(names, row, strict=True))


def _included(
    matrix: Matrix, rules: Rules, names: list[str], values: dict[str, list[Scalar]], total: int
) -> list[Scenario]:
    """Combinations by name: they count whatever the rules and the lists say, but never twice."""
    added: list[Scenario] = []
    taken: set[tuple[object, ...]] = set()
    listed = {name: set(map(one_value, values[name])) for name in names}
    for row in matrix.include:
        combination = {name: row[name] for name in names}
        given = tuple(one_value(value) for value in combination.values())
        known = all(each in listed[name] for name, each in zip(names, given, strict=True))
        known = known and rules.excluding(combination) is None
        if not known and given not in taken:
            taken.add(given)
            added.append(Scenario(total + len(added), combination))
    return added


def _chosen(
    matrix: Matrix, allowed: list[Scenario], values: dict[str, list[Scalar]]
) -> list[Scenario]:
    rows = [scenario.values for scenario in allowed]
    if matrix.sample == "pairwise":
        picked = pairwise(rows)
        if matrix.limit is not None and len(picked) > matrix.limit:
            raise MatrixError(
                f"covering every pair of values takes {len(picked)} combinations, and matrix.limit"
                f" is {matrix.limit}: raise it, or write sample: stratified"
            )
        return [allowed[index] for index in picked]
    if matrix.limit is None or matrix.limit >= len(allowed):
        return allowed
    weights = {name: _weights(variable) for name, variable in matrix.variables.items()}
    by_value = {
        name: dict(zip(map(one_value, values[name]), weights[name], strict=True)) for name in values
    }
    picked = stratified(
        [
            {name: (one_value(v), by_value[name].get(one_value(v), 1.0)) for name, v in row.items()}
            for row in rows
        ],
        matrix.limit,
        matrix.sample_seed,
    )
    return [allowed[index] for index in picked]


def _weights(variable: Variable) -> list[float]:
    if isinstance(variable, Choices):
        return [choice.weight for choice in variable.choices]
    return [1.0] * len(values_of(variable))
