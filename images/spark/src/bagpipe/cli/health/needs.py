"""What a job names in its namespace and takes of its quota, from its spec alone. Pure."""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field

from bagpipe.pod_spec import PodSettings, Toleration, Volume
from bagpipe.quantities import quantity
from bagpipe.spec import SimulationJobSpec, claims, evaluator_config_maps, stack_images


@dataclass(frozen=True)
class PodNeed:
    """What a node must have for one pod of a role: amounts in cores, bytes and pieces."""

    role: str
    amounts: dict[str, float]
    selector: dict[str, str] = field(default_factory=dict)
    tolerations: list[Toleration] = field(default_factory=list)
    has_affinity: bool = False


@dataclass(frozen=True)
class Needs:
    """Names of objects, and amounts as a quota counts them (cores, bytes, pods).

    `loosens` are fields of stack.securityContext that Pod Security's level `restricted` refuses.
    """

    claims: list[str] = field(default_factory=list)
    secrets: list[str] = field(default_factory=list)
    config_maps: list[str] = field(default_factory=list)
    priorities: list[str] = field(default_factory=list)
    amounts: dict[str, float] = field(default_factory=dict)
    loosens: list[str] = field(default_factory=list)
    pods: list[PodNeed] = field(default_factory=list)


def needs_of(spec: SimulationJobSpec) -> Needs:
    """Of a job, as the operator and Spark will make its pods."""
    pods = [spec.spark.driver.pod, spec.spark.executor.pod]
    volumes = [volume for pod in pods for volume in pod.volumes]
    named = {*claims(spec), *_claims_of(volumes)}
    secrets = {*spec.storage.secrets, *_pull_secrets(pods), *_secrets_of(volumes)}
    maps = {*evaluator_config_maps(spec), *_maps_of(volumes)}
    for source in spec.stack.env_from:
        secrets |= _required(source.secret_ref)
        maps |= _required(source.config_map_ref)
    for variable in spec.stack.env:
        if variable.value_from is not None:
            secrets |= _required(variable.value_from.secret_key_ref)
            maps |= _required(variable.value_from.config_map_key_ref)
    return Needs(
        sorted(named),
        sorted(secrets),
        sorted(maps),
        sorted({pod.priority_class_name for pod in pods if pod.priority_class_name}),
        _amounts(spec),
        list(_loosened(spec)),
        _pod_needs(spec),
    )


def _pod_needs(spec: SimulationJobSpec) -> list[PodNeed]:
    """Of a driver and of an executor, whose stack stands once for each image."""
    driver, executor = spec.spark.driver, spec.spark.executor
    asked = (spec.stack.resources.limits or {}) | (spec.stack.resources.requests or {})
    stack = {what: quantity(str(amount)) for what, amount in asked.items()}
    images = len(stack_images(spec))
    own = {"cpu": quantity(executor.resources.cpu), "memory": quantity(executor.resources.memory)}
    whole = own | {
        what: own.get(what, 0.0) + images * amount for what, amount in sorted(stack.items())
    }
    least = {"cpu": quantity(driver.resources.cpu), "memory": quantity(driver.resources.memory)}
    return [
        _pod_need("the driver", least, driver.pod),
        _pod_need("an executor", whole, executor.pod),
    ]


def _pod_need(role: str, amounts: dict[str, float], pod: PodSettings) -> PodNeed:
    return PodNeed(role, amounts, pod.node_selector, pod.tolerations, bool(pod.affinity))


def _required(reference: object) -> set[str]:
    if reference is None or getattr(reference, "optional", None):
        return set()
    return {str(getattr(reference, "name", ""))}


def _pull_secrets(pods: Iterable[PodSettings]) -> set[str]:
    return {secret.name for pod in pods for secret in pod.image_pull_secrets}


def _claims_of(volumes: Iterable[Volume]) -> set[str]:
    found = (volume.persistent_volume_claim for volume in volumes)
    return {claim.claim_name for claim in found if claim is not None}


def _secrets_of(volumes: Iterable[Volume]) -> set[str]:
    found = {v.secret.secret_name for v in volumes if v.secret and not v.secret.optional}
    for volume in volumes:
        for source in volume.projected.sources if volume.projected else []:
            if source.secret is not None and not source.secret.optional:
                found.add(source.secret.name)
    return found


def _maps_of(volumes: Iterable[Volume]) -> set[str]:
    found = {v.config_map.name for v in volumes if v.config_map and not v.config_map.optional}
    for volume in volumes:
        for source in volume.projected.sources if volume.projected else []:
            if source.config_map is not None and not source.config_map.optional:
                found.add(source.config_map.name)
    return found


def _amounts(spec: SimulationJobSpec) -> dict[str, float]:
    """By the names that a ResourceQuota has. A stack without a limit counts as far as it says."""
    spark, images = spec.spark, len(stack_images(spec))
    # All of them may be there at once, also where their number goes up and down.
    executors = spark.most_executors
    found = {"pods": float(executors + 1)}
    for what in ("cpu", "memory"):
        driver = quantity(getattr(spark.driver.resources, what))
        executor = quantity(getattr(spark.executor.resources, what))
        requests = (spec.stack.resources.requests or {}).get(what)
        limits = (spec.stack.resources.limits or {}).get(what)
        asked = requests if requests is not None else limits
        stack = images * quantity(str(asked)) if asked is not None else 0.0
        found[f"requests.{what}"] = driver + executors * (executor + stack)
        if what == "memory" and limits is not None:
            most = images * quantity(str(limits))
            found["limits.memory"] = driver + executors * (executor + most)
    return found | {"cpu": found["requests.cpu"], "memory": found["requests.memory"]}


def _loosened(spec: SimulationJobSpec) -> Iterator[str]:
    security = spec.stack.security_context
    if security.run_as_user == 0:
        yield "runAsUser: 0"
    if security.run_as_non_root is False:
        yield "runAsNonRoot: false"
    if security.capabilities.drop is not None and "ALL" not in security.capabilities.drop:
        yield "capabilities.drop without ALL"
