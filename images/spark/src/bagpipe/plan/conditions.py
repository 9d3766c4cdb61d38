"""Under which conditions a fragment is played: a scenario of the matrix, a variant, a round.

Crossing them with the fragments gives the cases. The order is fragment by fragment, so that a
job that is stopped early has compared its variants on what it ran.
"""

from collections.abc import Iterator
from dataclasses import dataclass, field

from pydantic import JsonValue

from bagpipe.matrix.expand import Expansion, expand
from bagpipe.spec import SimulationJobSpec


@dataclass(frozen=True)
class Conditions:
    """What one case adds to its fragment; the defaults are a job without matrix and variants.

    `scenario` is the combination's number in the matrix, `seed` counts its repetitions with other
    random numbers, `round` those with everything alike.
    """

    variant: str = ""
    scenario: int | None = None
    values: dict[str, JsonValue] = field(default_factory=dict)
    seed: int = 0
    round: int = 0

    @property
    def known(self) -> dict[str, JsonValue]:
        """What templates may name."""
        return self.values | {"seed": self.seed, "variant": self.variant}


@dataclass(frozen=True)
class Crossing:
    """Every condition of a job with the part of a case's name that distinguishes it."""

    named: list[tuple[str, Conditions]]
    expansion: Expansion | None = None


def crossing(spec: SimulationJobSpec) -> Crossing:
    """The conditions that each fragment is played under. Raises MatrixError."""
    expansion = expand(spec.matrix) if spec.matrix else None
    return Crossing(list(_named(spec, expansion)), expansion)


def _named(
    spec: SimulationJobSpec, expansion: Expansion | None
) -> Iterator[tuple[str, Conditions]]:
    variants = [variant.name for variant in spec.variants] or [""]
    for scenario_name, scenario in _scenarios(spec, expansion):
        for variant in variants:
            for suffix, number in _rounds(spec.playback.rounds):
                name = scenario_name + (f"-{variant}" if variant else "") + suffix
                yield (
                    name,
                    Conditions(variant, scenario.scenario, scenario.values, scenario.seed, number),
                )


def _scenarios(
    spec: SimulationJobSpec, expansion: Expansion | None
) -> Iterator[tuple[str, Conditions]]:
    if expansion is None or spec.matrix is None:
        yield "", Conditions()
        return
    width = len(str(expansion.combinations + len(spec.matrix.include) - 1))
    seed_width = len(str(spec.matrix.seeds - 1))
    for scenario in expansion.scenarios:
        seed = f".{scenario.seed:0{seed_width}d}" if spec.matrix.seeds > 1 else ""
        conditions = Conditions("", scenario.number, dict(scenario.values), scenario.seed)
        yield f"-s{scenario.number:0{width}d}{seed}", conditions


def _rounds(count: int) -> list[tuple[str, int]]:
    """Suffixes of the cases of one fragment; of one width, so that names sort by round."""
    if count == 1:
        return [("", 0)]
    digits = len(str(count - 1))
    return [(f"-r{number:0{digits}d}", number) for number in range(count)]
