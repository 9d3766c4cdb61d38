"""What each engine declares of itself: what it reads of a spec, and which agent's engine runs it.

Engines are found, not listed: each folder below `bagpipe.engine`, and below `bagpipe_engines` in
any place on Python's path. Its name is the one in `stack.engine`, and its module `fields` has
`FIELDS`. The spec asks here, also in the operator's image, so `fields` imports nothing that runs a
case.
"""

import functools
import importlib
import importlib.util
import pkgutil
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any, Literal

from pydantic import BaseModel

# The second is a namespace package, without an __init__.py: several distributions may share it.
_PACKAGES = ("bagpipe.engine", "bagpipe_engines")
# Of a job that names none, as the CRD has it.
DEFAULT_ENGINE = "ros1"


@dataclass(frozen=True)
class EngineFields:
    """One engine. Fields of the spec are written as in `playback.wait_for`.

    `needed` has the sentence for a field that is missing, `meaningless` the one for fields of which
    none may be there.
    """

    # The agent's own engine that runs its cases, as HELLO names it.
    agent: str
    # Who wrote a line of a stack's log that no program's name marks.
    unmarked_lines: Literal["stack", "agent"]
    # The kinds of source that it takes, the usual one first.
    sources: tuple[str, ...]
    needed: Mapping[str, str] = field(default_factory=dict)
    meaningless: Mapping[tuple[str, ...], str] = field(default_factory=dict)


class EnginesError(Exception):
    """The engines that are installed can't be used: two have one name, or one can't be loaded."""


@functools.cache
def engine_modules() -> Mapping[str, str]:
    """The module of each engine that is installed by its name; nothing is imported.

    The default's is first, the others follow by name. Raises EnginesError.
    """
    found: dict[str, str] = {}
    for name, module in _folders():
        if name in found:
            raise EnginesError(
                f"{found[name]} and {module} are engines of one name: remove one, or rename it"
            )
        found[name] = module
    return dict(sorted(found.items(), key=lambda each: (each[0] != DEFAULT_ENGINE, each[0])))


def engine_names() -> list[str]:
    """The values of `stack.engine`, the default first."""
    return list(engine_modules())


@functools.cache
def fields_of(name: str) -> EngineFields:
    """What an engine declares; its name is one of `engine_names`. Raises EnginesError."""
    fields: EngineFields = of_engine(name, "fields")
    return fields


def of_engine(name: str, part: str) -> Any:
    """The object of an engine that its module `part` names in capitals. Raises EnginesError."""
    module = f"{engine_modules()[name]}.{part}"
    try:
        return getattr(importlib.import_module(module), part.upper())
    except Exception as error:  # an added engine's code may raise anything
        raise EnginesError(
            f"the engine's module {module} can't be loaded ({type(error).__name__}: {error}):"
            " install the engine as a whole, or remove its folder"
        ) from error


def load_engines() -> None:
    """Reads each engine's fields from disk, once: for a process whose event loop must not wait.

    Raises EnginesError.
    """
    for name in engine_names():
        fields_of(name)


def refusal(spec: BaseModel, engine: str, source: str) -> str | None:
    """Why an engine can't run a spec with this kind of source; None where it can.

    Raises EnginesError.
    """
    fields = fields_of(engine)
    for path, sentence in fields.needed.items():
        if not _written(spec, path):
            return sentence
    if source not in fields.sources:
        takers = [name for name in engine_names() if source in fields_of(name).sources]
        return (
            f"source.{source} need stack.engine: {' or '.join(takers)}:"
            f" write source.{fields.sources[0]}"
        )
    for paths, sentence in fields.meaningless.items():
        if any(_written(spec, path) for path in paths):
            return sentence
    return None


def _folders() -> Iterator[tuple[str, str]]:
    for package in _PACKAGES:
        found = importlib.util.find_spec(package)
        places = found.submodule_search_locations if found else None
        for each in pkgutil.iter_modules(places or []):
            if each.ispkg:
                yield each.name, f"{package}.{each.name}"


def _written(spec: BaseModel, path: str) -> bool:
    """Whether a field has another value than its default; below what is left out none has."""
    *parents, name = path.split(".")
    model = spec
    for parent in parents:
        below: BaseModel | None = getattr(model, parent)
        if below is None:
            return False
        model = below
    default = type(model).model_fields[name].get_default(call_default_factory=True)
    return bool(getattr(model, name) != default)
