"""What each engine declares of itself: what it reads of a spec, and which agent's engine runs it.

Engines are found as `bagpipe.installed` says; the folder's name is the one in `stack.engine`.
"""

import functools
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any, Literal

from pydantic import BaseModel

from bagpipe.installed import Installed, meaningless_in, written

_ENGINES = Installed("engine", "bagpipe.engine", "bagpipe_engines")
# Of a job that names none, as the CRD has it.
DEFAULT_ENGINE = "ros1"


def _no_refusal(_spec: Any) -> None:
    return None


@dataclass(frozen=True)
class Example:
    """A usual command, and the parameter by which nodes take the time of /clock.

    `needed` is what an image must have for it, `file` a regular expression of the paths of which
    one shows that it is there, without a slash in front, and `remedy` what to do about it else.
    """

    middleware: str
    command: tuple[str, ...]
    sim_time: str
    needed: str
    file: str
    remedy: str


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
    # Why it can't run the rest of a spec, which is given whole; None where it can.
    refusal: Callable[[Any], str | None] = _no_refusal
    # What the messages are that it plays, as recordings name it; none: it takes bytes of any kind.
    encoding: str | None = None
    # Reasons of its own for a case that does not pass, which the driver's metrics count by name.
    reasons: frozenset[str] = frozenset()
    # What a first job of it looks like, where `encoding` says what it plays.
    example: "Example | None" = None


def engine_names() -> list[str]:
    """The values of `stack.engine`, the default first. Raises InstallationError."""
    return sorted(_ENGINES.modules, key=lambda name: (name != DEFAULT_ENGINE, name))


@functools.cache
def fields_of(name: str) -> EngineFields:
    """What an engine declares; its name is one of `engine_names`. Raises InstallationError."""
    fields: EngineFields = of_engine(name, "fields")
    return fields


def of_engine(name: str, part: str) -> Any:
    """The object of an engine's module `part`. Raises InstallationError."""
    return _ENGINES.part(name, part)


def engines_by_encoding() -> dict[str, str]:
    """The engines that play messages of an encoding, by it, the default first."""
    encodings = ((fields_of(name).encoding, name) for name in engine_names())
    return {encoding: name for encoding, name in encodings if encoding is not None}


def load_engines() -> None:
    """Reads each engine's fields from disk, once. Raises InstallationError."""
    for name in engine_names():
        fields_of(name)


def refusal(spec: BaseModel, engine: str, source: str, taken_as: str) -> str | None:
    """Why an engine can't run a spec with this kind of source; None where it can.

    `taken_as` is the kind that an engine takes for it. Raises InstallationError.
    """
    fields = fields_of(engine)
    for path, sentence in fields.needed.items():
        if not written(spec, path):
            return sentence
    if taken_as not in fields.sources:
        takers = [name for name in engine_names() if taken_as in fields_of(name).sources]
        instead = f"write source.{fields.sources[0]}"
        if not takers:
            return f"no engine that is here takes source.{source}: {instead}"
        return f"source.{source} need stack.engine: {' or '.join(takers)}: {instead}"
    return meaningless_in(spec, fields.meaningless) or fields.refusal(spec)
