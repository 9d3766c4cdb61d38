"""Expressions of users in CEL (the Common Expression Language), checked before use."""

import re
from collections.abc import Collection, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    import cel

# What the library raises for text that does not parse and for what can't be computed.
_FAULTS = (ArithmeticError, LookupError, RuntimeError, TypeError, ValueError)
# Names that macros bind, such as x of list.exists(x, ...).
_BOUND = re.compile(r"[.](?:all|exists|exists_one|filter|map)\(\s*([A-Za-z_][A-Za-z0-9_]*)\s*,")


class ExpressionError(ValueError):
    """What is wrong, to follow the expression's text in a sentence."""


class UnknownNamesError(ExpressionError):
    """It names what is not there; who knows what is there says so."""


@dataclass(frozen=True)
class Expression:
    """One that compiled."""

    text: str
    _program: "cel.Program"
    # Those of the names that it may use which it does use.
    names: frozenset[str]

    @classmethod
    def compiled(cls, text: str, names: Collection[str]) -> "Expression":
        """One that may use these names. Raises ExpressionError."""
        import cel  # noqa: PLC0415  it loads a shell of its own: half a second

        try:
            program = cel.compile(text)
        except _FAULTS as error:
            raise ExpressionError(f"is no expression: {_first_line(error)}") from error
        # The names that macros bind are listed as well.
        named = set(program.variables())
        unknown = sorted(named - set(names) - set(_BOUND.findall(text)))
        if unknown:
            raise UnknownNamesError(f"names {', '.join(unknown)}")
        return cls(text, program, frozenset(named & set(names)))

    def holds(self, values: Mapping[str, Any]) -> bool:
        """Raises ExpressionError where it can't be computed, or gives neither true nor false."""
        try:
            answer = self._program.execute(dict(values))
        except _FAULTS as error:
            raise ExpressionError(f"can't be computed: {_first_line(error)}") from error
        if not isinstance(answer, bool):
            raise ExpressionError(
                f"gives {answer!r} and neither true nor false: write a comparison"
            )
        return answer


def _first_line(error: BaseException) -> str:
    return str(error).splitlines()[0] if str(error) else type(error).__name__
