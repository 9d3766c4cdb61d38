"""The spec of a SimulationJob, as the CRD defines it, and the files that carry it between parts.

The API server has validated a manifest before anything here reads it; these models give
the rest of the code types, defaults and parsed durations. They refuse what the CRD
refuses, so that a job read from a file on a laptop meets the same rules.
"""

import re
from typing import Annotated, Literal, Self

from pydantic import (
    AfterValidator,
    BaseModel,
    ConfigDict,
    Field,
    JsonValue,
    model_validator,
)
from pydantic.alias_generators import to_camel

_DURATION = re.compile(r"(\d+(?:\.\d+)?)(ms|s|m|h)")
_UNIT_SECONDS = {"ms": 0.001, "s": 1.0, "m": 60.0, "h": 3600.0}


def duration_seconds(text: str) -> float:
    """Seconds of a duration such as `20s`, `1m30s` or `500ms`.

    Raises ValueError for anything else.
    """
    if not re.fullmatch(rf"(?:{_DURATION.pattern})+", text):
        raise ValueError(f"{text!r} is not a duration: write for example 20s, 1m30s or 500ms")
    return sum(float(n) * _UNIT_SECONDS[unit] for n, unit in _DURATION.findall(text))


def _known_scheme(uri: str) -> str:
    if not re.match(r"^(pvc://[a-z0-9][a-z0-9.-]*/|file:///)", uri):
        raise ValueError(
            f"{uri!r} has no known scheme: write pvc://<claim>/<path> or file:///<path>"
        )
    if ".." in uri.split("/"):
        raise ValueError(f"{uri!r} leaves its volume: write the path without '..'")
    return uri


def _positive_duration(text: str) -> str:
    if duration_seconds(text) <= 0:
        raise ValueError(f"{text!r} must be above zero")
    return text


def _any_duration(text: str) -> str:
    duration_seconds(text)
    return text


def _absolute_name(name: str) -> str:
    if not name.startswith("/"):
        raise ValueError(f"{name!r} must begin with a slash: write /{name}")
    return name


Uri = Annotated[str, AfterValidator(_known_scheme)]
Name = Annotated[str, AfterValidator(_absolute_name)]
Duration = Annotated[str, AfterValidator(_any_duration)]
PositiveDuration = Annotated[str, AfterValidator(_positive_duration)]


class _Model(BaseModel):
    model_config = ConfigDict(
        alias_generator=to_camel, populate_by_name=True, frozen=True, extra="ignore"
    )


class Fragment(_Model):
    """How a bag is cut: windows of about `length`, each led in by `warm_up` that does not count."""

    length: PositiveDuration = "60s"
    warm_up: Duration = "0s"


class Source(_Model):
    """The recordings that are played."""

    bags: list[Uri] = Field(min_length=1)
    topics: list[Name] = []
    fragment: Fragment = Fragment()


class EnvironmentVariable(_Model):
    """One environment variable of the stack."""

    name: str
    value: str = ""


class Stack(_Model):
    """The software under test: an unmodified image and how its nodes are started."""

    image: str = Field(min_length=1)
    command: list[str] = Field(min_length=1)
    env: list[EnvironmentVariable] = []
    parameters: dict[Name, JsonValue] = {}
    remap: dict[Name, Name] = {}
    image_pull_policy: Literal["Always", "IfNotPresent", "Never"] = "IfNotPresent"
    resources: dict[str, JsonValue] = {}


class Step(_Model):
    """An input topic of lock-step and the answer that the next input waits for."""

    trigger: Name
    answer: Name
    deadline: PositiveDuration = "2s"
    by: Literal["count", "stamp"] = "count"
    optional: bool = False


class Playback(_Model):
    """How the messages are released."""

    mode: Literal["realtime", "max", "lockstep"] = "realtime"
    steps: list[Step] = []
    rate: float = Field(default=1.0, gt=0, le=100)
    subscribe_timeout: PositiveDuration = "20s"
    case_timeout: PositiveDuration = "10m"

    @model_validator(mode="after")
    def _steps_belong_to_lockstep(self) -> Self:
        if (self.mode == "lockstep") != bool(self.steps):
            raise ValueError("playback.steps and playback.mode: lockstep belong together")
        return self


class Record(_Model):
    """What is recorded: regular expressions that match whole topic names."""

    topics: list[str] = Field(min_length=1)


class PodResources(_Model):
    """CPU and memory of one Spark container, in Kubernetes' quantities."""

    cpu: str = "500m"
    memory: str = "1Gi"


class SparkRole(_Model):
    """The driver's or the executors' size."""

    resources: PodResources = PodResources()


class Spark(_Model):
    """How wide the job runs."""

    executors: int = Field(default=1, ge=1, le=1000)
    slots: int = Field(default=1, ge=1, le=64)
    driver: SparkRole = SparkRole()
    executor: SparkRole = SparkRole()


class Output(_Model):
    """Where the recorded bags and the results go."""

    uri: Uri


class SimulationJobSpec(_Model):
    """`spec` of a SimulationJob (crds/simulationjobs.yaml)."""

    source: Source
    stack: Stack
    playback: Playback = Playback()
    record: Record
    spark: Spark = Spark()
    output: Output


class Images(_Model):
    """The images of Bagpipe's own containers."""

    spark: str
    agent: str


class JobFile(_Model):
    """job.json: what the operator tells the driver, and all that the driver knows."""

    name: str
    namespace: str
    uid: str
    attempt: int = Field(ge=1)
    spec: SimulationJobSpec
    images: Images
    volumes: dict[str, str] = {}


def claims(spec: SimulationJobSpec) -> dict[str, bool]:
    """The volume claims that a spec's URIs name, each with whether it may be mounted read-only."""
    found = {_claim(uri): True for uri in spec.source.bags if uri.startswith("pvc://")}
    if spec.output.uri.startswith("pvc://"):
        found[_claim(spec.output.uri)] = False
    return found


def _claim(uri: str) -> str:
    return uri.removeprefix("pvc://").split("/", 1)[0]
