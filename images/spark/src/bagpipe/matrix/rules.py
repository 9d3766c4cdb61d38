"""The rules that exclude combinations: CEL expressions over the variables, checked before use."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from bagpipe.expressions import Expression, ExpressionError, UnknownNamesError
from bagpipe.matrix.faults import MatrixError
from bagpipe.matrix.model import Exclusion, Scalar


@dataclass(frozen=True)
class Rule:
    """One compiled exclusion."""

    when: Expression
    because: str


@dataclass(frozen=True)
class Rules:
    """All exclusions of a matrix, the first that holds decides."""

    rules: tuple[Rule, ...]

    @classmethod
    def compiled(
        cls, exclusions: Sequence[Exclusion], variables: Mapping[str, Sequence[Scalar]]
    ) -> "Rules":
        """Raises MatrixError for a rule that does not parse or names what is no variable."""
        return cls(
            tuple(
                Rule(_expression(number, rule.when, variables), rule.because)
                for number, rule in enumerate(exclusions)
            )
        )

    def excluding(self, values: Mapping[str, Scalar]) -> Rule | None:
        """The rule that leaves this combination out, or None. Raises MatrixError."""
        for number, rule in enumerate(self.rules):
            try:
                if rule.when.holds(values):
                    return rule
            except ExpressionError as error:
                raise MatrixError(
                    f"{_place(number, rule.when.text)} {error} (for {shown(values)})"
                ) from error
        return None


def shown(values: Mapping[str, Scalar]) -> str:
    """A combination as people read it."""
    return ", ".join(f"{name}={value}" for name, value in values.items())


def _place(number: int, when: str) -> str:
    return f"matrix.exclude[{number}] ({when})"


def _expression(number: int, when: str, variables: Mapping[str, Sequence[Scalar]]) -> Expression:
    try:
        return Expression.compiled(when, variables)
    except UnknownNamesError as error:
        raise MatrixError(
            f"{_place(number, when)} {error}, which is no variable of the matrix: it has"
            f" {', '.join(sorted(variables))}"
        ) from error
    except ExpressionError as error:
        raise MatrixError(f"{_place(number, when)} {error}") from error
