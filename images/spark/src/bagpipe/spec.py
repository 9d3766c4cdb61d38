"""The spec of a SimulationJob, as the CRD defines it, and the files that carry it between parts.

The API server has validated a manifest before anything here reads it; these models give
the rest of the code types, defaults and parsed durations. They refuse what the CRD
refuses, so that a job read from a file on a laptop meets the same rules.
"""

from typing import Annotated, Literal, Self, TypeVar

from pydantic import (
    AfterValidator,
    BaseModel,
    ConfigDict,
    Field,
    JsonValue,
    ValidationInfo,
    field_validator,
    model_validator,
)

from bagpipe.bounds import MOST_PARAMETERS, MOST_VALUES, has_at_most, holds_at_most
from bagpipe.engine_fields import DEFAULT_ENGINE, engine_names, load_engines, refusal
from bagpipe.evaluate.model import RAN, Criterion, of_results, topics_of
from bagpipe.executor_range import ExecutorRange, Executors, least_of, most_of, wanted
from bagpipe.faults import FaultRule
from bagpipe.matrix.model import Matrix
from bagpipe.pod_spec import (
    SPEC_CONFIG,
    EnvironmentSource,
    PodSettings,
    Resources,
    SparkMount,
    StackMount,
    StackSecurity,
    ValueSource,
)
from bagpipe.quarantine import QuarantineRule
from bagpipe.ros1_spec import Ros1
from bagpipe.ros2_spec import Ros2
from bagpipe.source_fields import source_fields
from bagpipe.source_spec import InstalledSource
from bagpipe.texts import (
    BagUri,
    Duration,
    Name,
    NodeName,
    OutputUri,
    PositiveDuration,
    ReceiverName,
    SecretName,
    TopicPattern,
    each_once,
)
from bagpipe.topic_patterns import records

# Where the operator mounts the ConfigMaps of users' evaluators, in the executors alone.
EVALUATORS_PATH = "/etc/bagpipe/evaluators"
DEFAULT_BACKOFF_LIMIT = 3


class _Model(BaseModel):
    model_config = SPEC_CONFIG


class PlainVariable(_Model):
    """One environment variable with its value."""

    name: str = Field(pattern=r"^[A-Za-z_][A-Za-z0-9_]*$")
    value: str = ""


# ROS parameters: any value of JSON.
_Parameters = Annotated[
    dict[Name, JsonValue], holds_at_most(MOST_VALUES), has_at_most(MOST_PARAMETERS)
]

_Variable = TypeVar("_Variable", bound=PlainVariable)


def _variables_once(variables: list[_Variable]) -> list[_Variable]:
    each_once([variable.name for variable in variables])
    return variables


class EnvironmentVariable(PlainVariable):
    """One environment variable of the stack, which may come from the cluster."""

    value_from: ValueSource | None = None

    @model_validator(mode="after")
    def _one_of_them(self) -> Self:
        if self.value and self.value_from is not None:
            raise ValueError(
                "a variable of stack.env has a value or a valueFrom: write one of them"
            )
        return self


def _installed(engine: str) -> str:
    if engine not in engine_names():
        raise ValueError(
            f"stack.engine is {engine!r}, and the engines here are {', '.join(engine_names())}:"
            " write one of them"
        )
    return engine


class Stack(_Model):
    """The software under test: an unmodified image and how its nodes are started."""

    image: str = Field(pattern=r"^\S+$")
    command: list[str] = Field(min_length=1)
    engine: Annotated[str, AfterValidator(_installed)] = DEFAULT_ENGINE
    env: Annotated[list[EnvironmentVariable], AfterValidator(_variables_once)] = []
    parameters: _Parameters = {}
    remap: dict[Name, Name] = {}
    ros1: Ros1 | None = None
    ros2: Ros2 | None = None
    image_pull_policy: Literal["Always", "IfNotPresent", "Never"] = "IfNotPresent"
    resources: Resources = Resources()
    env_from: list[EnvironmentSource] = []
    volume_mounts: list[StackMount] = []
    security_context: StackSecurity = StackSecurity()


class Variant(_Model):
    """One version or configuration of the stack: what differs from `stack`."""

    name: str = Field(pattern=r"^[a-z0-9]([-a-z0-9]*[a-z0-9])?$", max_length=40)
    image: str = Field(default="", pattern=r"^\S*$")
    command: list[str] = []
    env: Annotated[list[PlainVariable], AfterValidator(_variables_once)] = []
    parameters: _Parameters = {}
    remap: dict[Name, Name] = {}


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
    rounds: int = Field(default=1, ge=1, le=100)
    wait_for: Annotated[list[NodeName], AfterValidator(each_once)] = Field(
        default=[], max_length=64
    )
    subscribe_timeout: PositiveDuration = "20s"
    case_timeout: PositiveDuration = "10m"

    @model_validator(mode="after")
    def _steps_belong_to_lockstep(self) -> Self:
        if self.steps and self.mode != "lockstep":
            raise ValueError("playback.steps are for playback.mode: lockstep: write that as well")
        return self


class Record(_Model):
    """What is recorded: regular expressions that match whole topic names."""

    topics: Annotated[list[TopicPattern], AfterValidator(each_once)] = Field(min_length=1)


class PodResources(_Model):
    """CPU and memory of one Spark container, in Kubernetes' quantities."""

    cpu: str = "500m"
    memory: str = "1Gi"


class SparkRole(_Model):
    """The driver's or the executors' size."""

    resources: PodResources = PodResources()
    volume_mounts: list[SparkMount] = []
    pod: PodSettings = PodSettings()


class Spark(_Model):
    """How wide the job runs."""

    executors: Executors = 1
    slots: int = Field(default=1, ge=1, le=64)
    pool: str | None = Field(default=None, pattern=r"^[a-z]([-a-z0-9]*[a-z0-9])?$", max_length=40)
    driver: SparkRole = SparkRole()
    executor: SparkRole = SparkRole()

    @property
    def is_elastic(self) -> bool:
        """Whether executors come and go with what there is to do."""
        return isinstance(self.executors, ExecutorRange)

    @property
    def most_executors(self) -> int:
        """How many there are at most: what quotas must have room for."""
        return most_of(self.executors)

    @property
    def most_slots(self) -> int:
        """How many cases run side by side at most."""
        return self.most_executors * self.slots

    def executors_for(self, cases: int) -> int:
        """How many are wanted while so many cases run or wait."""
        return wanted(least_of(self.executors), self.most_executors, self.slots, cases)


class Output(_Model):
    """Where the recorded bags and the results go."""

    uri: OutputUri


class Baseline(_Model):
    """An earlier job that this one is compared with: its results, or whichever passed last."""

    results: BagUri | None = None
    last_passed: str | None = Field(
        default=None, pattern=r"^schedule/[a-z]([-a-z0-9]*[a-z0-9])?$", max_length=40
    )

    @model_validator(mode="after")
    def _one_of_them(self) -> Self:
        if (self.results is None) == (self.last_passed is None):
            raise ValueError("baseline has results or lastPassed: write one of them")
        return self


class ComparisonRules(_Model):
    """What a comparison may say and the job pass nevertheless."""

    allow: Annotated[
        list[Literal["Regressed", "Missing", "WorseCriteria", "Unknown"]], AfterValidator(each_once)
    ] = Field(default=[], max_length=4)


class StorageAccess(_Model):
    """Secrets of the job's namespace that hold credentials; the values are never in a spec."""

    secrets: Annotated[list[SecretName], AfterValidator(each_once)] = Field(
        default=[], max_length=8
    )


class SimulationJobSpec(_Model):
    """`spec` of a SimulationJob (crds/simulationjobs.yaml)."""

    # Built when it is first used: what is installed may be broken, and is read to build it.
    model_config = ConfigDict(defer_build=True)

    source: InstalledSource
    stack: Stack
    variants: list[Variant] = Field(default=[], max_length=16)
    matrix: Matrix | None = None
    playback: Playback = Playback()
    record: Record | None = None
    spark: Spark = Spark()
    storage: StorageAccess = StorageAccess()
    output: Output
    baseline: Baseline | None = None
    comparison: ComparisonRules = ComparisonRules()
    evaluate: list[Criterion] = Field(default=[], max_length=100)
    max_failed_cases: int | None = Field(default=None, ge=0, le=10_000_000)
    backoff_limit: int = Field(default=DEFAULT_BACKOFF_LIMIT, ge=0, le=20)
    fault_policy: list[FaultRule] = Field(default=[], max_length=10)
    quarantine: list[QuarantineRule] = Field(default=[], max_length=50)
    managed_by: str | None = Field(
        default=None, pattern=r"^[a-z0-9]([-a-z0-9.]*[a-z0-9])?/[A-Za-z0-9][-A-Za-z0-9_.]*$"
    )
    suspend: bool = False
    queue_name: str | None = Field(default=None, pattern=r"^[a-z0-9]([-a-z0-9]*[a-z0-9])?$")
    start_deadline: PositiveDuration = "24h"
    active_deadline: PositiveDuration | None = None
    ttl_after_finished: Duration | None = None
    resume_from: str | None = Field(default=None, pattern=r"^[a-z]([-a-z0-9]*[a-z0-9])?$")
    notify: Annotated[list[ReceiverName], AfterValidator(each_once)] = Field(
        default=[], max_length=8
    )

    @property
    def compared_with(self) -> str | None:
        """The URI of the results that this job is compared with, as far as they are known."""
        return self.baseline.results if self.baseline is not None else None

    @field_validator("variants")
    @classmethod
    def _each_variant_once(cls, variants: list[Variant]) -> list[Variant]:
        names = [variant.name for variant in variants]
        if len(set(names)) != len(names):
            raise ValueError("two variants have one name: give each a name of its own")
        return variants

    @field_validator("fault_policy")
    @classmethod
    def _each_cause_once(cls, rules: list[FaultRule]) -> list[FaultRule]:
        if len({rule.cause for rule in rules}) != len(rules):
            raise ValueError("faultPolicy has two rules of one cause: write one")
        return rules

    @field_validator("quarantine")
    @classmethod
    def _each_pattern_once(cls, rules: list[QuarantineRule]) -> list[QuarantineRule]:
        if len({rule.cases for rule in rules}) != len(rules):
            raise ValueError("quarantine names the same cases twice: write them once")
        return rules

    @field_validator("evaluate")
    @classmethod
    def _each_criterion_once(cls, criteria: list[Criterion]) -> list[Criterion]:
        names = [criterion.name for criterion in criteria]
        if len(set(names)) != len(names):
            raise ValueError("two criteria have one name: give each a name of its own")
        return criteria

    @classmethod
    def of_results(cls, spec: JsonValue) -> Self:
        """The spec of a job that was run once, by whatever rules there were. Raises ValidationError
        where it has not a spec's form.
        """
        return cls.model_validate(spec, context={RAN: True})

    @model_validator(mode="after")
    def _rules(self, info: ValidationInfo) -> Self:
        """What fields must mean together."""
        if of_results(info):
            return self
        self._evaluators_see_no_credentials()
        self._latency_is_of_real_time()
        self._criteria_read_what_is_recorded()
        self._claims_are_the_pods()
        self._source_s_own_rules()
        self._engine_s_own_fields()
        return self

    def _evaluators_see_no_credentials(self) -> None:
        """A user's evaluator runs as the worker's own user, who could read its environment."""
        if self.storage.secrets and evaluator_config_maps(self):
            raise ValueError(
                "an own evaluator runs beside the worker and could read what storage.secrets give"
                " it: leave one of them out"
            )

    def _latency_is_of_real_time(self) -> None:
        """Else bag time waits for the stack, however long it takes."""
        late = next((each.name for each in self.evaluate if each.latency), None)
        if late is not None and self.playback.mode == "lockstep":
            raise ValueError(
                f"evaluate[{late}] has latency, and in lock-step an answer has the time of its"
                " input, however long it took: write a deadline into playback.steps, or play in"
                " realtime"
            )
        if late is not None and self.playback.mode == "max":
            raise ValueError(
                f"evaluate[{late}] has latency, and in max an answer has the time of the last input"
                " that was handed over, however long it took: play in realtime"
            )

    def _criteria_read_what_is_recorded(self) -> None:
        """A criterion over a topic that is never recorded could only ever be invalid."""
        patterns = list(self.record.topics) if self.record else []
        patterns += source_fields(self.source.kind).topics(self.source.own)
        for criterion in self.evaluate:
            for topic in topics_of(criterion)[0]:
                if not any(records(pattern, topic) for pattern in patterns):
                    raise ValueError(
                        f"evaluate[{criterion.name}] reads {topic}, which record.topics does not"
                        " have: add it there"
                    )

    def _claims_are_the_pods(self) -> None:
        claims = {claim.name for claim in self.spark.executor.pod.resource_claims}
        for asked in self.stack.resources.claims or []:
            if asked.name not in claims:
                raise ValueError(
                    f"stack.resources.claims has {asked.name}, which spark.executor.pod"
                    ".resourceClaims lacks: write it there, for example {name: gpu,"
                    " resourceClaimTemplateName: one-gpu}"
                )

    def _source_s_own_rules(self) -> None:
        refused = source_fields(self.source.kind).refusal(self)
        if refused is not None:
            raise ValueError(refused)

    def _engine_s_own_fields(self) -> None:
        kind = self.source.kind
        taken_as = source_fields(kind).taken_as or kind
        refused = refusal(self, self.stack.engine, kind, taken_as)
        if refused is not None:
            raise ValueError(refused)


class Images(_Model):
    """The images of Bagpipe's own containers, and when kubelets pull them."""

    spark: str
    agent: str
    pull_policy: Literal["Always", "IfNotPresent", "Never"] = "IfNotPresent"


class EarlierResults(_Model):
    """The results of the job that spec.resumeFrom names: their folder, and its planned cases."""

    job: str
    results: OutputUri
    cases: int = Field(ge=1)


class FoundBaseline(_Model):
    """What was found for spec.baseline.lastPassed: a job that passed, or why there is none.

    The job's results are `baseline.results` of the spec that comes with it; where there is no job,
    that spec has no baseline.
    """

    schedule: str
    job: str = ""
    message: str = Field(default="", max_length=1024)


class JobFile(_Model):
    """job.json: what the operator passes to the driver, and all that the driver knows."""

    model_config = ConfigDict(defer_build=True)

    name: str
    namespace: str
    uid: str
    attempt: int = Field(ge=1)
    spec: SimulationJobSpec
    images: Images
    volumes: dict[str, str] = {}
    resume: EarlierResults | None = None
    baseline: FoundBaseline | None = None
    # What the job's object says of itself, and when it was created: for the record alone.
    labels: dict[str, str] = {}
    annotations: dict[str, str] = {}
    created: str = ""
    # Where the results are kept, if not below spec.output.uri: `bagpipe run` has a folder.
    results: str = ""


def load_installed() -> None:
    """Reads the fields of engines and sources from disk, once, and builds the models with them.

    For a process whose event loop must not wait. Raises InstallationError.
    """
    load_engines()
    SimulationJobSpec.model_rebuild()
    JobFile.model_rebuild()


def stack_images(spec: SimulationJobSpec) -> list[str]:
    """The images that a job's cases need, each once, the baseline's first.

    Image n runs in a container of its own in every executor, whose agent has the shared volume's
    folder `shared_folder(n)`.
    """
    images = [variant.image or spec.stack.image for variant in spec.variants]
    return list(dict.fromkeys(images or [spec.stack.image]))


def shared_folder(shared: str, number: int) -> str:
    """The folder that the agent beside image `number` makes its slots in."""
    return shared if number == 0 else f"{shared}/image-{number}"


def evaluator_config_maps(spec: SimulationJobSpec) -> list[str]:
    """The ConfigMaps with users' evaluators, each once."""
    return sorted({c.own.config_map for c in spec.evaluate if c.own is not None})


def storage_uris(spec: SimulationJobSpec) -> list[str]:
    """All URIs of a spec, as it has them: of recordings and files, of results, of a baseline's."""
    earlier = [spec.compared_with] if spec.compared_with is not None else []
    return [*spec.source.uris, *earlier, spec.output.uri]


def claims(spec: SimulationJobSpec) -> dict[str, bool]:
    """The volume claims that a spec's URIs name, each with whether it may be mounted read-only."""
    found = {_claim(uri): True for uri in spec.source.uris if uri.startswith("pvc://")}
    if spec.compared_with is not None and spec.compared_with.startswith("pvc://"):
        found[_claim(spec.compared_with)] = True
    if spec.output.uri.startswith("pvc://"):
        found[_claim(spec.output.uri)] = False
    return found


def _claim(uri: str) -> str:
    return uri.removeprefix("pvc://").split("/", 1)[0]
