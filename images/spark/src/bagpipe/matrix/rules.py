"""The rules that exclude combinations: CEL expressions over the variables, checked before use."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

from bagpipe.matrix.faults import MatrixError
from bagpipe.matrix.model import Exclusion, Scalar

if TYPE_CHECKING:
    import cel

# What the expression library raises for text that does not parse and for what can't be computed.
_FAULTS = (LookupError, RuntimeError, TypeError, ValueError)


@dataclass(frozen=True)
class Rule:
    """One compiled exclusion."""

    when: str
    because: str
    program: "cel.Program"


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
                Rule(
                    rule.when, rule.because, _program(f"matrix.exclude[{number}]", rule, variables)
                )
                for number, rule in enumerate(exclusions)
            )
        )

    def excluding(self, values: Mapping[str, Scalar]) -> Rule | None:
        """The rule that leaves this combination out, or None. Raises MatrixError."""
        for number, rule in enumerate(self.rules):
            try:
                answer = rule.program.execute(dict(values))
            except _FAULTS as error:
                raise MatrixError(
                    f"matrix.exclude[{number}] ({rule.when}) can't be computed for"
                    f" {shown(values)}: {_first_line(error)}"
                ) from error
            if not isinstance(answer, bool):
                raise MatrixError(
                    f"matrix.exclude[{number}] ({rule.when}) gives {answer!r} and neither true nor"
                    " false: write a comparison"
                )
            if answer:
                return rule
        return None


def shown(values: Mapping[str, Scalar]) -> str:
    """A combination as people read it."""
    return ", ".join(f"{name}={value}" for name, value in values.items())


def _program(
    where: str, rule: Exclusion, variables: Mapping[str, Sequence[Scalar]]
) -> "cel.Program":
    import cel  # noqa: PLC0415  it loads a shell of its own: half a second

    try:
        program = cel.compile(rule.when)
    except _FAULTS as error:
        raise MatrixError(
            f"{where} ({rule.when}) is no expression: {_first_line(error)}"
        ) from error
    # Macros such as list.exists(x, ...) bind names of their own, which are listed as well, so an
    # unknown name is refused only where the whole expression has no macro.
    unknown = sorted(set(program.variables()) - set(variables))
    if unknown and not any(f".{macro}(" in rule.when for macro in _MACROS):
        raise MatrixError(
            f"{where} ({rule.when}) names {', '.join(unknown)}, which is no variable of the matrix:"
            f" it has {', '.join(sorted(variables))}"
        )
    return program


_MACROS = ("all", "exists", "exists_one", "filter", "map")


def _first_line(error: BaseException) -> str:
    return str(error).splitlines()[0] if str(error) else type(error).__name__
