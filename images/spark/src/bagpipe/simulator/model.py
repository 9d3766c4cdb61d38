"""`source.simulator` as the CRD defines it, with its templates not yet filled in."""

import json
import re
from typing import Annotated, Self

from pydantic import AfterValidator, BaseModel, ConfigDict, Field, JsonValue, model_validator
from pydantic.alias_generators import to_camel

from bagpipe.bounds import MOST_VALUES, holds_at_most
from bagpipe.matrix.templates import has_template
from bagpipe.pieces import RecordedTopics
from bagpipe.simulator.scenario import Scenario
from bagpipe.texts import duration_nanoseconds

# Steps of one case: its recording and the answers' time are bounded with them.
_MOST_STEPS = 100_000
_SHORTEST_STEP = 10**6
# The drive's first moment, in ns: a node takes the time 0 for "no time yet".
START = 1_000_000_000


def _length(text: str) -> str:
    refusal = ValueError(f"{text!r} is not a duration: write for example 100ms or 20s")
    if "h" in text:  # as the CRD has it: no drive lasts for hours
        raise refusal
    try:
        length = duration_nanoseconds(text)
    except ValueError:
        raise refusal from None
    if length < _SHORTEST_STEP:
        raise ValueError(f"{text!r} is shorter than 1ms")
    return text


def _topic(name: str) -> str:
    if not re.fullmatch(r"(/[A-Za-z]\w*)+", name):
        raise ValueError(f"{name!r} is no topic: write for example /ego/odom")
    return name


Length = Annotated[str, AfterValidator(_length)]
Topic = Annotated[str, AfterValidator(_topic)]


# With templates or without; what it means is read once it is known to be of a size that can be.
_Open = Annotated[dict[str, JsonValue], holds_at_most(MOST_VALUES)]


class Topics(BaseModel):
    """The names under which the simulator speaks, and under which it is steered."""

    model_config = ConfigDict(
        frozen=True, extra="forbid", alias_generator=to_camel, populate_by_name=True
    )

    odometry: Topic = "/ego/odom"
    obstacles: Topic = "/obstacles"
    collision: Topic = "/ego/collision"
    lights: Topic = "/lights"
    points: Topic = "/points"
    scene: Topic = "/scene"
    control: Topic = "/cmd"

    @model_validator(mode="after")
    def _each_once(self) -> Self:
        names = [*self.spoken, self.control]
        if len(set(names)) != len(names):
            raise ValueError("two of source.simulator.topics have one name: give each its own")
        return self

    @property
    def spoken(self) -> list[str]:
        """What the simulator may publish on."""
        return [
            self.odometry, self.obstacles, self.collision, self.lights, self.points, self.scene,
        ]  # fmt: skip


class Simulator(BaseModel):
    """A simulated drive: how long, in which steps, and the scenario as it is written.

    `ego`, `scene`, `actors` and `lidar` may hold templates; `scenario()` reads them filled.
    """

    model_config = ConfigDict(
        frozen=True, extra="ignore", alias_generator=to_camel, populate_by_name=True
    )

    step: Length = "100ms"
    duration: Length
    topics: Topics = Topics()
    ego: _Open = {}
    scene: _Open = {}
    actors: Annotated[list[dict[str, JsonValue]], holds_at_most(MOST_VALUES)] = Field(
        default=[], max_length=64
    )
    lidar: _Open | None = None
    recorded: list[RecordedTopics] = Field(default=[], max_length=20)

    @model_validator(mode="after")
    def _makes_sense(self) -> Self:
        if not 1 <= self.steps <= _MOST_STEPS:
            raise ValueError(
                f"source.simulator.duration ({self.duration}) must be 1 to {_MOST_STEPS} times"
                f" its step ({self.step})"
            )
        if not has_template(self.described):
            Scenario.model_validate(self.described)
        return self

    @model_validator(mode="after")
    def _each_topic_has_one_source(self) -> Self:
        taken = {"/clock", self.topics.control, *self.topics.spoken}
        for topic in self.recorded_topics:
            if topic in taken:
                raise ValueError(
                    f"source.simulator.recorded has {topic}, which the simulator or the stack says"
                    " or an entry before: leave it out, or rename the simulator's own in"
                    " source.simulator.topics"
                )
            taken.add(topic)
        return self

    @property
    def recorded_topics(self) -> list[str]:
        """The topics that are played from recordings."""
        return [topic for piece in self.recorded for topic in piece.topics]

    @property
    def step_nanoseconds(self) -> int:
        """Simulated time between two moments that the stack sees."""
        return duration_nanoseconds(self.step)

    @property
    def steps(self) -> int:
        """How many moments the stack sees."""
        return duration_nanoseconds(self.duration) // self.step_nanoseconds

    @property
    def described(self) -> dict[str, JsonValue]:
        """The scenario as it is written, templates and all."""
        written: dict[str, JsonValue] = {
            "ego": self.ego, "scene": self.scene, "actors": list(self.actors),
        }  # fmt: skip
        if self.lidar is not None:
            written["lidar"] = self.lidar
        copied: dict[str, JsonValue] = json.loads(json.dumps(written))
        return copied
