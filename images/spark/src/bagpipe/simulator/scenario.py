"""One scenario with all its values: the ego car, the static scene, the others, the sensor.

Lengths in metres, times in seconds, speeds in m/s, angles in radians; x along the road, y to the
left (REP 103). Lane 0 is the rightmost, with y = 0 at its centre.
"""

from typing import Annotated, Literal, Self

from pydantic import ConfigDict, Field, model_validator
from pydantic.alias_generators import to_camel

from bagpipe.bounds import FewKeys

Finite = Annotated[float, Field(allow_inf_nan=False, ge=-1e5, le=1e5)]
Size = Annotated[float, Field(gt=0, le=1000)]
Speed = Annotated[float, Field(ge=0, le=60)]
Seconds = Annotated[float, Field(ge=0, le=1e5)]
Direction = Literal[
    "front", "front-left", "left", "rear-left", "rear", "rear-right", "right", "front-right"
]
# Where one is, seen from the ego car: distances ahead, lanes to the left.
DIRECTIONS: dict[Direction, tuple[int, int]] = {
    "front": (1, 0),
    "front-left": (1, 1),
    "left": (0, 1),
    "rear-left": (-1, 1),
    "rear": (-1, 0),
    "rear-right": (-1, -1),
    "right": (0, -1),
    "front-right": (1, -1),
}
# The paper's three speeds, as parts of the ego car's own at the start.
RELATIVE_SPEEDS = {"slower": 0.8, "equal": 1.0, "faster": 1.2}
# Length and width.
SIZES = {
    "car": (4.5, 1.8), "truck": (12.0, 2.5), "bicycle": (1.8, 0.6), "pedestrian": (0.6, 0.6),
}  # fmt: skip


class _Part(FewKeys):
    model_config = ConfigDict(
        frozen=True, extra="forbid", alias_generator=to_camel, populate_by_name=True
    )


class Ego(_Part):
    """The car that the stack drives (vehicle.py), and how it starts."""

    model: Literal["kinematic", "singleTrack"] = "kinematic"
    vehicle: Literal[1, 2, 3] = 2
    x: Finite = 0.0
    lane: int = Field(default=0, ge=0, lt=32)
    heading: Finite = 0.0
    speed: Speed = 0.0


class Barrier(_Part):
    """A fixed obstacle, about its centre."""

    x: Finite
    y: Finite
    heading: Finite = 0.0
    length: Size = 1.0
    width: Size = 1.0


class Phase(_Part):
    """What a traffic light shows, and for how long."""

    shows: Literal["red", "yellow", "green"]
    seconds: Annotated[float, Field(gt=0, le=1e5)]


class Light(_Part):
    """A traffic light: its phases follow each other from the first on, again and again."""

    name: str = Field(min_length=1, max_length=63)
    program: list[Phase] = Field(min_length=1, max_length=32, fail_fast=True)


class StopLine(_Part):
    """A line across all lanes; with a light, what the light says holds for it."""

    x: Finite
    light: str = ""


class Scene(_Part):
    """What stands still."""

    lanes: int = Field(default=1, ge=1, le=32)
    lane_width: Size = 3.5
    length: Size = 1000.0
    barriers: list[Barrier] = Field(default=[], max_length=200, fail_fast=True)
    stop_lines: list[StopLine] = Field(default=[], max_length=50, fail_fast=True)
    lights: list[Light] = Field(default=[], max_length=50, fail_fast=True)

    @model_validator(mode="after")
    def _lights_are_there(self) -> Self:
        names = [light.name for light in self.lights]
        for line in self.stop_lines:
            if line.light and line.light not in names:
                raise ValueError(
                    f"the stop line at x = {line.x:g} has the light {line.light!r}, and the"
                    f" scene's lights are {', '.join(names) or 'none'}: name one of them"
                )
        if len(set(names)) != len(names):
            raise ValueError("two lights have one name: give each a name of its own")
        return self


class Start(_Part):
    """Where an actor starts: beside the ego car by `direction`, or at `x` on `lane`."""

    direction: Direction | None = None
    distance: Size = 20.0
    x: Finite | None = None
    lane: int | None = Field(default=None, ge=-1, lt=33)
    heading: Finite = 0.0

    @model_validator(mode="after")
    def _one_way(self) -> Self:
        if (self.direction is None) == (self.x is None and self.lane is None):
            raise ValueError(
                "an actor's start is either a direction, such as front-left, or x and lane"
            )
        if self.direction is None and (self.x is None or self.lane is None):
            raise ValueError("an actor's start needs both x and lane")
        return self


class Action(_Part):
    """One line of an actor's script: from `at` on, within `over`, it changes lanes or speed."""

    at: Seconds
    over: Annotated[float, Field(gt=0, le=1000)] = 3.0
    lanes: int = Field(default=0, ge=-8, le=8)
    speed: Speed | None = None


class Actor(_Part):
    """Somebody else on the road, who drives as the script says and looks at nobody.

    `motion` is the paper's: straight on, or a lane change to the left or right that begins at
    `after`.
    """

    name: str = Field(default="actor", min_length=1, max_length=63)
    kind: Literal["car", "truck", "bicycle", "pedestrian"] = "car"
    start: Start
    speed: Speed | Literal["slower", "equal", "faster"] = 0.0
    motion: Literal["straight", "left", "right"] = "straight"
    after: Seconds = 2.0
    script: list[Action] = Field(default=[], max_length=100, fail_fast=True)

    @property
    def actions(self) -> list[Action]:
        """The script with the motion in it, in time's order."""
        lanes = {"straight": 0, "left": 1, "right": -1}[self.motion]
        motion = [Action(at=self.after, lanes=lanes)] if lanes else []
        return sorted([*motion, *self.script], key=lambda action: action.at)


class Lidar(_Part):
    """A planar scanner on the ego car's centre: `beams` all around, every `every` steps."""

    beams: int = Field(default=360, ge=8, le=4096)
    range: Size = 80.0
    every: int = Field(default=1, ge=1, le=1000)


class Scenario(_Part):
    """All of it. Raises ValidationError where it makes no sense."""

    ego: Ego = Ego()
    scene: Scene = Scene()
    actors: list[Actor] = Field(default=[], max_length=64, fail_fast=True)
    lidar: Lidar | None = None

    @model_validator(mode="after")
    def _ego_is_on_the_road(self) -> Self:
        if self.ego.lane >= self.scene.lanes:
            raise ValueError(
                f"ego.lane is {self.ego.lane}, and the scene has {self.scene.lanes} lanes,"
                " counted from 0 at the right: write a smaller number or more lanes"
            )
        return self
