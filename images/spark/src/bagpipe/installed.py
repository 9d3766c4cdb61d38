"""Engines and sources are found, not listed: each is a folder, ours or another distribution's.

The folder's name is the one that a job writes. Each of its modules that is asked for has one
object, named as the module in capitals: `fields` has `FIELDS`, which is what the folder declares to
a spec. The spec asks here, also in the operator's image, so `fields` imports nothing that runs a
case.
"""

import importlib
import importlib.util
import pkgutil
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any

from pydantic import BaseModel


class InstallationError(Exception):
    """What is installed can't be used: two have one name, or one can't be loaded."""


@dataclass(frozen=True)
class Installed:
    """All folders of one kind, which `word` names in sentences, below `ours` and `shared`."""

    word: str
    ours: str
    # A namespace package, without an __init__.py: several distributions may share it.
    shared: str

    @cached_property
    def modules(self) -> Mapping[str, str]:
        """The module of each folder by its name, in that order; nothing is imported.

        Raises InstallationError.
        """
        found: dict[str, str] = {}
        for name, module in self._folders():
            if name in found:
                raise InstallationError(
                    f"{found[name]} and {module} are {self.word}s of one name: remove one, or"
                    " rename it"
                )
            found[name] = module
        return dict(sorted(found.items()))

    def part(self, name: str, part: str) -> Any:
        """The object of a folder's module `part`. Raises InstallationError."""
        module = f"{self.modules[name]}.{part}"
        try:
            return getattr(importlib.import_module(module), part.upper())
        except Exception as error:  # added code may raise anything
            raise InstallationError(
                f"the {self.word}'s module {module} can't be loaded"
                f" ({type(error).__name__}: {error}): install the {self.word} as a whole, or remove"
                " its folder"
            ) from error

    def _folders(self) -> Iterator[tuple[str, str]]:
        for package in (self.ours, self.shared):
            found = importlib.util.find_spec(package)
            places = found.submodule_search_locations if found else None
            for each in pkgutil.iter_modules(places or []):
                if each.ispkg:
                    yield each.name, f"{package}.{each.name}"


def meaningless_in(model: BaseModel, declared: Mapping[tuple[str, ...], str]) -> str | None:
    """The first sentence of those that refuse fields, of which any is written in the model."""
    for paths, sentence in declared.items():
        if any(written(model, path) for path in paths):
            return sentence
    return None


def written(model: BaseModel, path: str) -> bool:
    """Whether a field has another value than its default; below what is left out none has.

    `path` is as in `playback.wait_for`.
    """
    *parents, name = path.split(".")
    for parent in parents:
        below: BaseModel | None = getattr(model, parent)
        if below is None:
            return False
        model = below
    default = type(model).model_fields[name].get_default(call_default_factory=True)
    return bool(getattr(model, name) != default)
