"""The stack of one case: what every variant starts from, its variant's changes, its values."""

from pydantic import JsonValue

from bagpipe.matrix.faults import MatrixError
from bagpipe.matrix.templates import filled, filled_text
from bagpipe.plan.conditions import Conditions, Crossing, crossing
from bagpipe.spec import (
    EnvironmentVariable,
    PlainVariable,
    SimulationJobSpec,
    Stack,
    Variant,
    stack_images,
)


def image_of(spec: SimulationJobSpec, variant: str) -> int:
    """Which of `stack_images` a variant's cases run in."""
    return stack_images(spec).index(_variant(spec, variant).image or spec.stack.image)


def stack_of(spec: SimulationJobSpec, conditions: Conditions) -> Stack:
    """The stack as one case starts it. Raises MatrixError for a template that names nothing.

    A variant's environment, parameters and remaps are laid over the stack's, name by name; its
    image and command replace them. A job without matrix and variants has no templates.
    """
    variant = _variant(spec, conditions.variant)
    merged = spec.stack.model_copy(
        update={
            "image": variant.image or spec.stack.image,
            "command": variant.command or spec.stack.command,
            "env": _environment(spec.stack.env, variant.env),
            "parameters": spec.stack.parameters | variant.parameters,
            "remap": spec.stack.remap | variant.remap,
        }
    )
    if spec.matrix is None and not spec.variants:
        return merged
    return _filled(merged, conditions.known)


def check_templates(spec: SimulationJobSpec, made: Crossing | None = None) -> None:
    """Fills every variant's templates once. Raises MatrixError, before anything runs."""
    for _, conditions in (made or crossing(spec)).named:
        stack_of(spec, conditions)


def _variant(spec: SimulationJobSpec, name: str) -> Variant:
    for variant in spec.variants:
        if variant.name == name:
            return variant
    if name:
        raise MatrixError(f"no variant is called {name!r}")
    return Variant(name="stack")


def _environment(
    stack: list[EnvironmentVariable], variant: list[PlainVariable]
) -> list[EnvironmentVariable]:
    changed = [EnvironmentVariable(name=entry.name, value=entry.value) for entry in variant]
    return list({entry.name: entry for entry in [*stack, *changed]}.values())


def _filled(stack: Stack, known: dict[str, JsonValue]) -> Stack:
    return stack.model_copy(
        update={
            "command": [
                filled_text(word, known, f"stack.command[{place}]")
                for place, word in enumerate(stack.command)
            ],
            "env": [
                entry.model_copy(
                    update={"value": filled_text(entry.value, known, f"stack.env[{entry.name}]")}
                )
                for entry in stack.env
            ],
            "parameters": {
                name: filled(value, known, f"stack.parameters[{name}]")
                for name, value in stack.parameters.items()
            },
            "remap": {
                name: _topic(filled_text(value, known, f"stack.remap[{name}]"), name)
                for name, value in stack.remap.items()
            },
        }
    )


def _topic(name: str, of: str) -> str:
    if not name.startswith("/"):
        raise MatrixError(f"stack.remap[{of}] becomes {name!r}: a topic begins with a slash")
    return name
