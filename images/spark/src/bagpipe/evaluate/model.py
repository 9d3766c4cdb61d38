"""`spec.evaluate` as the CRD defines it: types and refusals; judge.py applies the criteria."""

import math
import re
from typing import Annotated, Any, Literal, Self

from pydantic import (
    AfterValidator,
    BaseModel,
    ConfigDict,
    Field,
    ValidationInfo,
    ValidatorFunctionWrapHandler,
    WrapValidator,
    model_validator,
)
from pydantic.alias_generators import to_camel

from bagpipe.texts import Duration, duration_seconds

# The same expressions stand in crds/simulationjobs.yaml; digits and letters are ASCII's.
_TOPIC = re.compile(r"(?:/[A-Za-z0-9_-]+)+")
_PART = r"[A-Za-z][A-Za-z0-9_]*(?:\[[0-9]{1,6}\])?"
_PATH = re.compile(rf"{_PART}(?:[.]{_PART})*")
_LONGEST_TIMEOUT = 86_400.0
# No heading is further from another one; releases before 0.2 wrote it where nothing was written.
_ANY_HEADING = 3.1415
# The last part of a path to a coordinate, which no turn brings back to where it was.
_PLACES = frozenset("xyz")
# In a validation's context: the job has been run, and its results are read.
RAN = "ran"


def of_results(info: ValidationInfo) -> bool:
    """Whether a spec is read with its results: a rule that is newer is no reason not to read it."""
    return bool(info.context and info.context.get(RAN))


def _topic(name: str) -> str:
    if not _TOPIC.fullmatch(name):
        raise ValueError(
            f"{name!r} is no topic: begin with a slash, and write letters, digits, underscores and"
            " hyphens, such as /imu/data"
        )
    return name


def _path(path: str) -> str:
    if not _PATH.fullmatch(path):
        raise ValueError(f"{path!r} is no field: write for example pose.pose.position.x")
    return path


def _finite(number: float, info: ValidationInfo) -> float:
    if not math.isfinite(number) and not of_results(info):
        raise ValueError("a bound must be a finite number")
    return number


def _as_written(given: Any, checked: ValidatorFunctionWrapHandler) -> Any:
    number = checked(given)
    return given if isinstance(given, int) else number


def _timeout(text: str) -> str:
    if not 0 < duration_seconds(text) <= _LONGEST_TIMEOUT:
        raise ValueError(f"{text!r} is no time to wait: write more than 0s and at most 24h")
    return text


Topic = Annotated[str, Field(max_length=256), AfterValidator(_topic)]
Path = Annotated[str, Field(max_length=256), AfterValidator(_path)]
Bound = Annotated[float, AfterValidator(_finite)]
# An integer as it is: not every one is a float.
ExactBound = Annotated[Bound, WrapValidator(_as_written)]
AboveZero = Annotated[Bound, Field(gt=0)]
Timeout = Annotated[Duration, AfterValidator(_timeout)]
# The least part of the window, or of the truth's samples, that a criterion must be judged on.
Share = Annotated[float, Field(ge=0, le=1)]


class _Model(BaseModel):
    # Strict: the API server takes no number for a text either.
    model_config = ConfigDict(
        alias_generator=to_camel, populate_by_name=True, frozen=True, extra="forbid", strict=True
    )


class _Bounded(_Model):
    """A figure that must lie between two bounds, of which one may be missing."""

    min: Bound | None = None
    max: Bound | None = None

    @model_validator(mode="after")
    def _some_bound(self) -> Self:
        if self.min is None and self.max is None:
            raise ValueError("neither min nor max is there: write one of them")
        if self.min is not None and self.max is not None and self.max < self.min:
            raise ValueError(f"max ({self.max:g}) is below min ({self.min:g}): swap them")
        return self


class Presence(_Model):
    """How many messages are recorded on a topic; at least one by default."""

    topic: Topic
    min: int = Field(default=1, ge=0)
    max: int | None = Field(default=None, ge=0)
    min_coverage: Share = 0.5

    @model_validator(mode="after")
    def _some_number(self) -> Self:
        if self.max is not None and self.max < self.min:
            raise ValueError(f"max ({self.max}) is below min ({self.min}): write min: 0 as well")
        return self

    @model_validator(mode="after")
    def _can_fail(self, info: ValidationInfo) -> Self:
        if self.min == 0 and self.max is None and not of_results(info):
            raise ValueError("min: 0 alone holds for every stack: write a greater one, or max")
        return self


class Rate(_Bounded):
    """Messages per second of a topic, over the case's window or over the worst gap in it."""

    topic: Topic
    over: Literal["window", "worst"] = "window"
    min_coverage: Share = 0.75

    @model_validator(mode="after")
    def _can_fail(self, info: ValidationInfo) -> Self:
        if self.min is not None and self.min <= 0 and self.max is None and not of_results(info):
            raise ValueError(
                f"min: {self.min:g} alone holds for every stack: write a greater one, or max"
            )
        return self


class Latency(_Model):
    """From a message's header stamp to its receipt; `percentile` of all of them."""

    topic: Topic
    percentile: float = Field(default=99.0, gt=0, le=100)
    max: Duration
    min_coverage: Share = 0.75


class FieldBounds(_Bounded):
    """Every value of a field lies between the bounds."""

    topic: Topic
    field: Path
    min: ExactBound | None = None
    max: ExactBound | None = None
    min_coverage: Share = 0.75


class Expression(_Model):
    """A CEL expression over each message, as `msg`, its time in seconds, as `t`.

    With `finite` NaN or infinity in what it reads fails it, whatever it makes of them.
    """

    topic: Topic
    holds: str = Field(min_length=1, max_length=1024)
    share: float = Field(default=1.0, gt=0, le=1)
    finite: bool = True
    min_coverage: Share = 0.75


class Error(_Model):
    """The distance of fields from a truth: another topic, or the recording's own output.

    Values are compared at the nearest stamp of the truth, at most `stamp_tolerance` away.
    """

    topic: Topic
    fields: list[Path] = Field(min_length=1, max_length=16)
    truth: Topic | None = None
    truth_fields: list[Path] = Field(default=[], max_length=16)
    recording: bool = False
    metric: Literal["rmse", "max", "final"] = "rmse"
    max: Bound
    stamp_tolerance: Duration = "50ms"
    angle: bool = False
    any_frame: bool = False
    min_coverage: Share = 0.9

    @model_validator(mode="after")
    def _one_truth(self, info: ValidationInfo) -> Self:
        if self.truth_fields and len(self.truth_fields) != len(self.fields):
            raise ValueError("truthFields and fields differ in number: write one for each field")
        if self.truth is None and not self.recording:
            raise ValueError("no truth is named: write truth: /topic, or recording: true")
        named = [path.rpartition(".")[2] for path in (*self.fields, *self.truth_fields)]
        places = self.angle and len(self.fields) > 1 and not _PLACES.isdisjoint(named)
        if places and not of_results(info):
            raise ValueError(
                "angle is for all fields, of which one is x, y or z: write a criterion for each"
                " angle, and one without angle for the place"
            )
        same_fields = self.truth_fields in ([], self.fields)
        itself = self.truth == self.topic and not self.recording and same_fields
        if itself and not of_results(info):
            raise ValueError(
                "a topic is compared with itself: name another truth, or write recording: true for"
                " what was recorded on it"
            )
        return self


class FinalPose(_Model):
    """Where the last pose of a topic (PoseStamped, Odometry, TransformStamped) must be: `position`
    is x and y, or x, y and z.

    Metres and radians, in the messages' own frame.
    """

    topic: Topic
    position: list[Bound] = Field(min_length=2, max_length=3)
    yaw: Bound | None = None
    max_distance: AboveZero
    max_yaw_error: AboveZero | None = None
    any_frame: bool = False
    min_coverage: Share = 0.9

    @model_validator(mode="after")
    def _a_bounded_heading(self, info: ValidationInfo) -> Self:
        bounded = self.max_yaw_error is not None and self.max_yaw_error < _ANY_HEADING
        if (self.yaw is not None) != bounded and not of_results(info):
            raise ValueError(
                "yaw and maxYawError go together: write both, the error below 3.1415, or neither"
            )
        return self


class Separation(_Model):
    """Between the ego car's Odometry and the obstacles of a PoseArray, in one frame.

    `min_distance` in metres between the centres; `min_time_to_collision` in seconds at the present
    speeds, for circles of `radius` metres each. A pose or a scene older than `max_age` says nothing
    of where things are.
    """

    ego: Topic
    obstacles: Topic
    radius: AboveZero = 1.5
    min_distance: Bound | None = Field(default=None, ge=0)
    min_time_to_collision: AboveZero | None = None
    max_age: Timeout = "1s"
    any_frame: bool = False
    min_coverage: Share = 0.9

    @model_validator(mode="after")
    def _some_bound(self) -> Self:
        if self.min_distance is None and self.min_time_to_collision is None:
            raise ValueError("write minDistance or minTimeToCollision")
        return self

    @model_validator(mode="after")
    def _can_fail(self, info: ValidationInfo) -> Self:
        if self.min_distance == 0 and not of_results(info):
            raise ValueError("minDistance: 0 holds at every distance: write a greater one")
        return self


class Resources(_Model):
    """What the stack used: CPU seconds per second of the case, and the most memory, in bytes."""

    max_cpu: AboveZero | None = None
    max_memory: str | None = Field(
        default=None, pattern=r"^[0-9]+([.][0-9]+)?([kMGT]|[KMGT]i)?$", max_length=32
    )
    min_coverage: Share = 0.9

    @model_validator(mode="after")
    def _some_bound(self) -> Self:
        if self.max_cpu is None and self.max_memory is None:
            raise ValueError("write maxCpu or maxMemory")
        return self


class OwnEvaluator(_Model):
    """A user's Python function from a ConfigMap of the job's namespace.

    It is run in a process of its own in the executor (docs/tasks/own-evaluator.md).
    """

    config_map: str = Field(pattern=r"^[a-z0-9]([-a-z0-9.]*[a-z0-9])?$", max_length=253)
    file: str = Field(
        default="evaluator.py", pattern=r"^[A-Za-z0-9_][A-Za-z0-9._-]*[.]py$", max_length=253
    )
    function: str = Field(default="evaluate", pattern=r"^[A-Za-z_][A-Za-z0-9_]*$", max_length=128)
    topics: list[Topic] = Field(default=[], max_length=100)
    timeout: Timeout = "60s"
    min_coverage: Share = 0.9


KINDS = (
    "presence", "rate", "latency", "bounds", "expression", "error", "finalPose", "separation",
    "resources", "own",
)  # fmt: skip


class Criterion(_Model):
    """One criterion: a name, exactly one kind of measurement, whether a failure is expected."""

    name: str = Field(min_length=1, max_length=63, pattern=r"^[A-Za-z0-9]([-A-Za-z0-9_. ]*)$")
    expect_failure: bool = False
    presence: Presence | None = None
    rate: Rate | None = None
    latency: Latency | None = None
    bounds: FieldBounds | None = None
    expression: Expression | None = None
    error: Error | None = None
    final_pose: FinalPose | None = None
    separation: Separation | None = None
    resources: Resources | None = None
    own: OwnEvaluator | None = None

    @property
    def kind(self) -> str:
        """Which measurement it is, as the manifest spells it."""
        return next(kind for kind in KINDS if getattr(self, _attribute(kind)) is not None)

    @property
    def measurement(self) -> BaseModel:
        """The kind's own model."""
        found: BaseModel = getattr(self, _attribute(self.kind))
        return found

    @model_validator(mode="after")
    def _one_kind(self) -> Self:
        given = [kind for kind in KINDS if getattr(self, _attribute(kind)) is not None]
        if len(given) != 1:
            raise ValueError(
                f"criterion {self.name} has {' and '.join(given) or 'no measurement'}:"
                f" write exactly one of {', '.join(KINDS)}"
            )
        return self


def _attribute(kind: str) -> str:
    return re.sub(r"([A-Z])", lambda found: f"_{found[1].lower()}", kind)


def topics_of(criterion: Criterion) -> tuple[list[str], list[str]]:
    """The topics that a criterion reads of the stack's recording, and of the job's own bag."""
    c = criterion
    for part in (c.presence, c.rate, c.latency, c.bounds, c.expression, c.final_pose):
        if part is not None:
            return [part.topic], []
    if c.separation is not None:
        return [c.separation.ego, c.separation.obstacles], []
    if c.own is not None:
        return list(c.own.topics), []
    if c.error is not None:
        truth = c.error.truth or c.error.topic
        return ([c.error.topic], [truth]) if c.error.recording else ([c.error.topic, truth], [])
    return [], []
