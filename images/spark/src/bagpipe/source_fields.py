"""What each source declares of itself: its key below `spec.source`, and what that means to a spec.

Sources are found as `bagpipe.installed` says; the folder's name is the key.
"""

import functools
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

from bagpipe.installed import Installed

_SOURCES = Installed("source", "bagpipe.source", "bagpipe_sources")


def _nothing(_own: Any) -> list[str]:
    return []


def _no_refusal(_spec: Any) -> None:
    return None


@dataclass(frozen=True)
class SourceFields:
    """One source. Functions are given what a job has written below its key, as `type` reads it.

    `default` stands for a key that is left out: None, or [] of a list, which may not be empty.
    """

    # As pydantic takes it.
    type: Any
    default: Any
    # What the cases are read from; volumes and rights to storage follow from them.
    uris: Callable[[Any], list[str]] = _nothing
    # Whether these are bags, which this machine must be able to read.
    bags: bool = True
    # Topics that the source itself publishes, which are recorded without being in record.topics.
    topics: Callable[[Any], list[str]] = _nothing
    # The kind that an engine takes for it; empty: only those take it that name itself.
    taken_as: str = ""
    # Fields of `spec.source` beside the key that it does not read, and the sentence against them.
    meaningless: Mapping[tuple[str, ...], str] = field(default_factory=dict)
    # Why it can't be played with the rest of a spec, which is given whole; None where it can.
    refusal: Callable[[Any], str | None] = _no_refusal
    # Reasons of its own for a case that does not pass, which the driver's metrics count by name.
    reasons: frozenset[str] = frozenset()
    # Of the key in the CRD; None of one that stands there by hand.
    schema: Mapping[str, Any] | None = None
    # Before whom it stands in sentences and in a spec that is written; of one place, by the name.
    place: int = 100


@functools.cache
def source_names() -> tuple[str, ...]:
    """The keys below `spec.source` of which a job has one. Raises InstallationError."""
    return tuple(sorted(_SOURCES.modules, key=lambda name: (source_fields(name).place, name)))


@functools.cache
def source_fields(name: str) -> SourceFields:
    """What a source declares; its name is one of `source_names`. Raises InstallationError."""
    fields: SourceFields = of_source(name, "fields")
    return fields


def of_source(name: str, part: str) -> Any:
    """The object of a source's module `part`. Raises InstallationError."""
    return _SOURCES.part(name, part)


def one_source_sentence() -> str:
    """What is asked of a job that has none of the sources, or two."""
    lists = [f"source.{name}" for name in source_names() if source_fields(name).default == []]
    others = [f"source.{name}" for name in source_names() if source_fields(name).default != []]
    listed = " and ".join([", ".join(lists[:-1]), lists[-1]])
    return f"write one of {listed}, with at least one URI, or {' or '.join(others)}"
