"""`spec.matrix` as the CRD defines it: types and refusals; expand.py makes the combinations."""

import math
import re
from typing import Annotated, Literal, Self

from pydantic import (
    AfterValidator,
    ConfigDict,
    Field,
    JsonValue,
    field_validator,
    model_validator,
)
from pydantic.alias_generators import to_camel

from bagpipe.bounds import MOST_VALUES as MOST_VALUES_OF_A_FIELD
from bagpipe.bounds import FewKeys, has_at_most, holds_at_most

# Names that templates and rules know besides the variables.
RESERVED_NAMES = frozenset({"seed", "variant"})
MOST_VALUES = 10_000

# Words that can't name a variable of an expression (the CEL specification's reserved words).
_CEL_WORDS = frozenset({
    "as", "break", "const", "continue", "else", "false", "for", "function", "if", "import", "in",
    "let", "loop", "namespace", "null", "package", "return", "true", "var", "void", "while",
})  # fmt: skip

Scalar = str | int | float | bool


class _Model(FewKeys):
    model_config = ConfigDict(
        alias_generator=to_camel, populate_by_name=True, frozen=True, extra="forbid"
    )


class Span(_Model):
    """Numbers from `from` to `to`, both included, `step` apart."""

    first: float | int = Field(alias="from")
    last: float | int = Field(alias="to")
    step: float | int = 1

    @model_validator(mode="after")
    def _ends(self) -> Self:
        if not all(math.isfinite(n) for n in (self.first, self.last, self.step)):
            raise ValueError("from, to and step must be finite numbers")
        if self.step <= 0:
            raise ValueError(f"step is {self.step:g}: write a step above zero")
        if self.last < self.first:
            raise ValueError(f"to ({self.last:g}) is below from ({self.first:g}): swap them")
        if (self.last - self.first) / self.step >= MOST_VALUES:
            raise ValueError(f"a range has at most {MOST_VALUES} values: write a larger step")
        whole = all(isinstance(n, int) for n in (self.first, self.step))
        if not whole and self.step < math.ulp(max(abs(self.first), abs(self.last))):
            raise ValueError(
                f"step ({self.step:g}) is less than numbers as large as {self.last:g} can differ"
                " by: write a larger one"
            )
        return self


class Choice(_Model):
    """A value with its weight in a sample."""

    value: Scalar
    weight: float = Field(default=1.0, gt=0, le=1e6)


class Choices(_Model):
    """Values of which some are wanted more often when `limit` takes a sample."""

    choices: list[Choice] = Field(min_length=1, max_length=MOST_VALUES, fail_fast=True)


def _known_scalar(value: JsonValue) -> JsonValue:
    """Values are strings, numbers and booleans: what a rule can compare and a name can show."""
    if isinstance(value, float) and not math.isfinite(value):
        raise ValueError("a value must be a finite number")
    return value


# After the first wrong one nobody reads on: there may be a hundred thousand.
Values = Annotated[list[Annotated[Scalar, AfterValidator(_known_scalar)]], Field(fail_fast=True)]
Variable = Values | Span | Choices


class Exclusion(_Model):
    """Combinations that are left out, and why."""

    when: str = Field(min_length=1, max_length=1024)
    because: str = Field(default="", max_length=1024)


class Matrix(_Model):
    """Variables and the rules over them."""

    variables: Annotated[
        dict[str, Variable], holds_at_most(MOST_VALUES_OF_A_FIELD), has_at_most()
    ] = Field(min_length=1, max_length=32)
    exclude: list[Exclusion] = Field(default=[], max_length=100, fail_fast=True)
    include: Annotated[
        list[Annotated[dict[str, Scalar], has_at_most()]], holds_at_most(MOST_VALUES_OF_A_FIELD)
    ] = Field(default=[], max_length=1000, fail_fast=True)
    seeds: int = Field(default=1, ge=1, le=10_000)
    limit: int | None = Field(default=None, ge=1, le=1_000_000)
    sample: Literal["stratified", "pairwise"] | None = None
    sample_seed: int = 0

    @field_validator("exclude", mode="before")
    @classmethod
    def _plain_rules(cls, rules: object) -> object:
        """A rule may be written as its expression alone."""
        if isinstance(rules, list):
            return [{"when": rule} if isinstance(rule, str) else rule for rule in rules]
        return rules

    @field_validator("variables")
    @classmethod
    def _usable_names(cls, variables: dict[str, Variable]) -> dict[str, Variable]:
        for name, values in variables.items():
            if not re.fullmatch(r"[A-Za-z_][A-Za-z0-9_]{0,62}", name) or name in _CEL_WORDS:
                raise ValueError(
                    f"{name!r} can't name a variable: write letters, digits and underscores"
                )
            if name in RESERVED_NAMES:
                raise ValueError(f"{name!r} has a meaning of its own: choose another name")
            _check_values(name, values)
        return variables

    @model_validator(mode="after")
    def _a_stratified_sample_has_a_size(self) -> Self:
        if self.sample == "stratified" and self.limit is None:
            raise ValueError(
                "matrix.sample: stratified takes matrix.limit combinations: write limit as well"
            )
        return self

    @model_validator(mode="after")
    def _whole_inclusions(self) -> Self:
        for number, row in enumerate(self.include):
            if set(row) != set(self.variables):
                given = ", ".join(sorted(row)) or "no variable"
                raise ValueError(
                    f"include[{number}] gives {given}: give each of"
                    f" {', '.join(sorted(self.variables))} a value"
                )
        return self


def one_value(value: Scalar) -> tuple[bool, Scalar]:
    """Equal for equal values: to an API server and to comparisons 1 and 1.0 are one, and 1 and true
    are two, although Python has these equal.
    """
    return (isinstance(value, bool), value)


def _check_values(name: str, values: Variable) -> None:
    if isinstance(values, Span):
        return
    listed = [c.value for c in values.choices] if isinstance(values, Choices) else values
    if not listed:
        raise ValueError(f"{name} has no value: write at least one")
    if len(listed) > MOST_VALUES:
        raise ValueError(f"{name} has {len(listed)} values, and may have {MOST_VALUES}")
    if len(set(map(one_value, listed))) != len(listed):
        raise ValueError(f"{name} names a value twice: leave one out")
