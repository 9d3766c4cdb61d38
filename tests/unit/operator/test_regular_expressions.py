"""No regular expression of the operator's process takes a hostile text more than linear time.

They are found by import, with those of the spec, whose models read what tenants write: one of them
stopped the operator for all tenants by a kilobyte, and one by an Event.
"""

import ast
import builtins
import importlib
import inspect
import re
import subprocess
import sys
from collections.abc import Iterator
from types import ModuleType
from typing import Any

import pytest
from pydantic import BaseModel

from tests.unit.operator.regex_steps import Steps, TooManyStepsError, hostile_texts

# In a process of its own: other tests import what no operator does.
_ALL = """
import importlib, pkgutil, sys
import bagpipe_operator
from bagpipe.installed import Installed
for found in pkgutil.walk_packages(bagpipe_operator.__path__, "bagpipe_operator."):
    importlib.import_module(found.name)
for module in list(sys.modules.values()):
    for each in [each for each in vars(module).values() if isinstance(each, Installed)]:
        for name in each.modules:
            each.part(name, "fields")
print(*(name for name in sys.modules if name.split(".")[0] in {"bagpipe", "bagpipe_operator"}))
"""
_CALLS = {"compile", "match", "search", "fullmatch", "sub", "subn", "split", "findall", "finditer"}
# Four times the text: a linear search takes four times the steps, a quadratic one sixteen.
_MOST = 5.0


@pytest.fixture(scope="module")
def modules() -> list[ModuleType]:
    """All that the operator has imported, or imports when it reads a spec."""
    command = [sys.executable, "-c", _ALL]
    listed = subprocess.run(command, check=True, capture_output=True, text=True, timeout=120)
    return [importlib.import_module(name) for name in sorted(listed.stdout.split())]


class _Anything(str):
    """What a local name stands for, whatever it is asked for."""

    __slots__ = ()

    def __getattr__(self, _name: str) -> "_Anything":
        return _Anything("x")


class _Locals(dict[str, Any]):
    def __init__(self, known: dict[str, Any]) -> None:
        super().__init__()
        self._known = known

    def __missing__(self, name: str) -> _Anything:
        if name in self._known or hasattr(builtins, name):
            raise KeyError(name)
        return _Anything("x")


def _kept(value: Any) -> Iterator[re.Pattern[Any]]:
    """The patterns of a module's value, and of lists and maps in it."""
    if isinstance(value, re.Pattern):
        yield value
    elif isinstance(value, dict | list | tuple | set | frozenset):
        for each in value.values() if isinstance(value, dict) else value:
            yield from _kept(each)


def _written(module: ModuleType) -> Iterator[re.Pattern[Any]]:
    """The patterns that its functions give to `re`."""
    for call in ast.walk(ast.parse(inspect.getsource(module))):
        if (
            isinstance(call, ast.Call)
            and isinstance(call.func, ast.Attribute)
            and isinstance(call.func.value, ast.Name)
            and (call.func.value.id, call.func.attr in _CALLS) == ("re", True)
        ):
            code = compile(ast.Expression(call.args[0]), module.__name__, "eval")
            yield re.compile(eval(code, vars(module), _Locals(vars(module))))  # noqa: S307


def _patterns(modules: list[ModuleType]) -> list[re.Pattern[Any]]:
    found: dict[tuple[str, int], re.Pattern[Any]] = {}
    for module in modules:
        values = [each for name, each in vars(module).items() if not name.startswith("__")]
        for pattern in (*_kept(values), *_written(module)):
            text = pattern.pattern
            text = text.decode("latin-1") if isinstance(text, bytes) else text
            found.setdefault((text, pattern.flags & ~re.UNICODE), pattern)
    return list(found.values())


def _growth(pattern: re.Pattern[Any]) -> tuple[float, str]:
    """By how much four times the text takes more steps at most, and a text of that kind."""
    steps, worst = Steps(pattern), (0.0, "")
    for text in hostile_texts(pattern):
        try:
            growth = steps.of(text(24)) / steps.of(text(6))
            if growth > _MOST:  # what has a bound, such as {1,63}, shows it in longer texts
                growth = steps.of(text(80)) / steps.of(text(20))
        except TooManyStepsError:
            return float("inf"), text(6)
        worst = max(worst, (growth, text(6)))
    return worst


def test_no_pattern_takes_more_than_linear_time(modules: list[ModuleType]) -> None:
    patterns = _patterns(modules)
    assert len(patterns) > 35
    growths = {str(pattern.pattern): _growth(pattern) for pattern in patterns}
    assert {text: found for text, found in growths.items() if found[0] > _MOST} == {}


def test_patterns_of_models_are_rust_s_which_are_linear(modules: list[ModuleType]) -> None:
    values = [value for module in modules for value in vars(module).values()]
    models = {v for v in values if isinstance(v, type) and issubclass(v, BaseModel)}
    assert len(models) > 40
    engines = {model.model_config.get("regex_engine", "rust-regex") for model in models}
    assert engines == {"rust-regex"}


@pytest.mark.parametrize(
    "pattern",
    [
        r"\.(?:initContainers|containers)\{([^}]+)\}$",
        r"\{\{\s*([^{}]*?)\s*\}\}",
        r'"(?:[^"\\]++|\\.)*+(?:"|\Z)',
        r"(?:a|aa)*b",
    ],
)
def test_what_is_not_linear_is_found(pattern: str) -> None:
    """The first three were the operator's: quadratic, cubic, quadratic. The last is exponential."""
    assert _growth(re.compile(pattern))[0] > 10


def test_what_counts_the_steps_finds_what_re_finds(modules: list[ModuleType]) -> None:
    compared = 0
    for pattern in _patterns(modules):
        steps = Steps(pattern)
        for text in hostile_texts(pattern):
            given: Any = text(2)
            steps.of(given)
            if isinstance(pattern.pattern, bytes):
                given = given.encode("latin-1")
            assert steps.spans == [found.span() for found in pattern.finditer(given)]
            compared += 1
    assert compared > 5_000
