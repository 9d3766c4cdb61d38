"""What a job may say of its pods: the part of Kubernetes' own fields that gives no pod more rights.

Only what is named here reaches a pod: the operator builds manifests from these models, so a field
that a cluster's older or wider CRD lets pass is left out.
"""

import re
from collections.abc import Sequence
from typing import Annotated, Literal, Self, TypeVar

from pydantic import AfterValidator, BaseModel, ConfigDict, Field, JsonValue, model_validator
from pydantic.alias_generators import to_camel

from bagpipe.bounds import MOST_VALUES_OF_AFFINITY, holds_at_most
from bagpipe.texts import each_once

# Whatever a manifest may write as a quantity: 1, "500m" or 2Gi.
Quantity = str | int | float


# Every part of a spec: camelCase outside, unknown fields left out.
SPEC_CONFIG = ConfigDict(
    # What was refused is not repeated in an error: it may hold a credential by mistake.
    hide_input_in_errors=True,
    alias_generator=to_camel,
    populate_by_name=True,
    frozen=True,
    extra="ignore",
)


class SpecModel(BaseModel):
    """A part of the settings of pods."""

    model_config = SPEC_CONFIG


def _plain_path(path: str) -> str:
    if not path.startswith("/") or re.search(r"^/+$|(^|/)[.][.](/|$)|:|//|/$", path):
        raise ValueError(f"{path!r} is no plain path below the root: write for example /opt/models")
    return path


def _path_of_the_stack(path: str) -> str:
    if re.search(r"^/(bagpipe|proc|sys|dev)(/|$)", path) and path != "/dev/shm":  # noqa: S108
        raise ValueError(f"{path!r} lies where the agent or the kernel has its files")
    return path


def _path_of_spark(path: str) -> str:
    if not path.startswith("/mnt/"):
        raise ValueError(f"{path!r} is not below /mnt: write for example /mnt/recordings")
    return path


def _path_in_volume(path: str) -> str:
    if path.startswith("/") or ".." in path.split("/"):
        raise ValueError(f"{path!r} leaves its volume: write a relative path without '..'")
    return path


PlainPath = Annotated[str, AfterValidator(_plain_path)]
PathInVolume = Annotated[str, AfterValidator(_path_in_volume)]


class KeyOf(SpecModel):
    """A key of a Secret or of a ConfigMap."""

    name: str
    key: str
    optional: bool | None = None


class FieldRef(SpecModel):
    """A field of the pod."""

    field_path: str


class ValueSource(SpecModel):
    """Where a variable's value comes from: exactly one of the three."""

    secret_key_ref: KeyOf | None = None
    config_map_key_ref: KeyOf | None = None
    field_ref: FieldRef | None = None

    @model_validator(mode="after")
    def _one_of_them(self) -> Self:
        if [self.secret_key_ref, self.config_map_key_ref, self.field_ref].count(None) < 2:
            raise ValueError("a variable comes from one place: write only one of the three")
        return self


class Named(SpecModel):
    """A Secret or a ConfigMap as a whole."""

    name: str
    optional: bool | None = None


class EnvironmentSource(SpecModel):
    """A Secret or a ConfigMap whose keys become variables."""

    prefix: str = ""
    secret_ref: Named | None = None
    config_map_ref: Named | None = None

    @model_validator(mode="after")
    def _one_of_them(self) -> Self:
        if (self.secret_ref is None) == (self.config_map_ref is None):
            raise ValueError(
                "an entry of stack.envFrom names one Secret or one ConfigMap: write for example"
                " secretRef: {name: licence}"
            )
        return self


class _Mount(SpecModel):
    name: str
    sub_path: PathInVolume | None = None
    read_only: bool | None = None


class StackMount(_Mount):
    """A volume in the stack's container."""

    mount_path: Annotated[PlainPath, AfterValidator(_path_of_the_stack)]


class SparkMount(_Mount):
    """A volume in a Spark container, which has its programs outside of /mnt."""

    mount_path: Annotated[PlainPath, AfterValidator(_path_of_spark)]


class Capabilities(SpecModel):
    """Which of a container's usual capabilities are taken away."""

    drop: list[str] | None = None


class StackSecurity(SpecModel):
    """Where the stack's container differs from Pod Security's level "restricted"."""

    run_as_non_root: bool | None = None
    run_as_user: int | None = Field(default=None, ge=0)
    run_as_group: int | None = Field(default=None, ge=0)
    read_only_root_filesystem: bool | None = None
    capabilities: Capabilities = Capabilities()


class _Entry(SpecModel):
    name: str = Field(max_length=63)


_Entries = TypeVar("_Entries", bound=Sequence[_Entry])


def _named_once(entries: _Entries) -> _Entries:
    each_once([entry.name for entry in entries])
    return entries


class DeviceRequest(_Entry):
    """A claim of the pod whose devices a container gets, or those of one of its requests."""

    request: str | None = Field(default=None, max_length=63)


class Resources(SpecModel):
    """What is set aside for a container, and what it may use at most; by resource name."""

    requests: dict[str, Quantity] | None = None
    limits: dict[str, Quantity] | None = None
    claims: Annotated[list[DeviceRequest], AfterValidator(_named_once)] | None = Field(
        default=None, max_length=8
    )


class Claim(SpecModel):
    """A PersistentVolumeClaim."""

    claim_name: str
    read_only: bool | None = None


class KeyAsFile(SpecModel):
    """A key, and the file that it becomes."""

    key: str
    path: PathInVolume


class _Files(SpecModel):
    optional: bool | None = None
    items: list[KeyAsFile] | None = None


class ConfigMapFiles(_Files):
    """A ConfigMap's keys as files."""

    name: str
    default_mode: int | None = None


class SecretFiles(_Files):
    """A Secret's keys as files."""

    secret_name: str
    default_mode: int | None = None


class ProjectedObject(_Files):
    """A ConfigMap or a Secret among others in one folder."""

    name: str


class ProjectedSource(SpecModel):
    """One of the two: never a ServiceAccount's token."""

    config_map: ProjectedObject | None = None
    secret: ProjectedObject | None = None


class Projected(SpecModel):
    """Several ConfigMaps and Secrets in one folder."""

    sources: list[ProjectedSource]
    default_mode: int | None = None


class EmptyDir(SpecModel):
    """A folder that ends with the pod."""

    medium: Literal["", "Memory"] = ""
    size_limit: Quantity | None = None


class Volume(SpecModel):
    """A volume of exactly one kind."""

    name: str
    persistent_volume_claim: Claim | None = None
    config_map: ConfigMapFiles | None = None
    secret: SecretFiles | None = None
    empty_dir: EmptyDir | None = None
    projected: Projected | None = None

    @model_validator(mode="after")
    def _one_kind(self) -> Self:
        # Kubernetes takes a volume of no known kind for an emptyDir.
        if [value is None for _, value in self].count(False) != 2:
            raise ValueError(
                f"volume {self.name} needs exactly one of persistentVolumeClaim, configMap, secret,"
                " emptyDir and projected"
            )
        if re.match(r"(shared|config|claim-.*|bagpipe-.*|spark-.*)$", self.name):
            raise ValueError(f"volume {self.name}: the name is Bagpipe's own, write another")
        return self


class Toleration(SpecModel):
    """A taint that a pod tolerates."""

    key: str | None = None
    operator: Literal["Exists", "Equal"] | None = None
    value: str | None = None
    effect: Literal["NoSchedule", "PreferNoSchedule", "NoExecute"] | None = None
    toleration_seconds: int | None = None


class Spread(SpecModel):
    """How evenly a job's pods of one role lie; which pods count is not the user's to say."""

    topology_key: str
    max_skew: int = Field(default=1, ge=1)
    when_unsatisfiable: Literal["DoNotSchedule", "ScheduleAnyway"] = "ScheduleAnyway"


class PullSecret(SpecModel):
    """A Secret by which images are pulled."""

    name: str


class DeviceClaim(_Entry):
    """Devices that are allocated to a pod: a ResourceClaim, or what makes each pod one."""

    name: str = Field(pattern=r"^[a-z0-9]([-a-z0-9]*[a-z0-9])?$", max_length=63)
    resource_claim_name: str | None = Field(default=None, min_length=1, max_length=253)
    resource_claim_template_name: str | None = Field(default=None, min_length=1, max_length=253)

    @model_validator(mode="after")
    def _one_of_them(self) -> Self:
        if (self.resource_claim_name is None) == (self.resource_claim_template_name is None):
            raise ValueError(
                f"resource claim {self.name} is either there or made from a template: write"
                " resourceClaimName or resourceClaimTemplateName"
            )
        return self


class PodSecurity(SpecModel):
    """Groups of a pod's processes."""

    fs_group: int | None = Field(default=None, ge=0)
    fs_group_change_policy: Literal["OnRootMismatch", "Always"] | None = None
    supplemental_groups: list[int] | None = None


class PodSettings(SpecModel):
    """What a job's pods of one role have beside what Bagpipe gives them."""

    labels: dict[str, str] = {}
    annotations: dict[str, str] = {}
    node_selector: dict[str, str] = {}
    tolerations: list[Toleration] = []
    affinity: Annotated[dict[str, JsonValue], holds_at_most(MOST_VALUES_OF_AFFINITY)] = {}
    topology_spread_constraints: list[Spread] = []
    priority_class_name: str = ""
    runtime_class_name: str = ""
    image_pull_secrets: list[PullSecret] = []
    resource_claims: Annotated[list[DeviceClaim], AfterValidator(_named_once)] = Field(
        default=[], max_length=8
    )
    security_context: PodSecurity = PodSecurity()
    volumes: list[Volume] = []
