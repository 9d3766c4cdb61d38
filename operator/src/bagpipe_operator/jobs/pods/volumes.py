"""How a job's pods reach its storage: claims as volumes and mounts, Secrets as environment."""

from bagpipe import storage_hosts
from bagpipe.secret_names import SECRET_PREFIX
from bagpipe.spec import (
    EVALUATORS_PATH,
    SimulationJobSpec,
    claims,
    evaluator_config_maps,
)
from bagpipe_operator.api import names
from bagpipe_operator.api.objects import Json
from bagpipe_operator.settings import Settings


def claim_paths(spec: SimulationJobSpec) -> dict[str, str]:
    """Where each claim is mounted, in the driver and in every executor."""
    return {claim: f"{names.VOLUMES_PATH}/{claim}" for claim in sorted(claims(spec))}


def claim_volumes(spec: SimulationJobSpec) -> list[Json]:
    """The pod's volumes. Named by number: a claim's name may be too long for a volume's."""
    return [
        {"name": f"claim-{index}", "persistentVolumeClaim": {"claimName": claim}}
        for index, claim in enumerate(sorted(claims(spec)))
    ]


def claim_mounts(spec: SimulationJobSpec) -> list[Json]:
    """One container's mounts; a claim that only holds recordings is mounted read-only."""
    return [
        {
            "name": f"claim-{index}",
            "mountPath": f"{names.VOLUMES_PATH}/{claim}",
            "readOnly": read_only,
        }
        for index, (claim, read_only) in enumerate(sorted(claims(spec).items()))
    ]


def evaluator_volumes(spec: SimulationJobSpec) -> list[Json]:
    """The ConfigMaps of users' evaluators, for the executors; a missing one keeps them waiting."""
    return [
        {"name": f"evaluator-{index}", "configMap": {"name": name}}
        for index, name in enumerate(evaluator_config_maps(spec))
    ]


def evaluator_mounts(spec: SimulationJobSpec) -> list[Json]:
    """Where the worker finds them."""
    return [
        {"name": f"evaluator-{index}", "mountPath": f"{EVALUATORS_PATH}/{name}", "readOnly": True}
        for index, name in enumerate(evaluator_config_maps(spec))
    ]


def secret_environment(spec: SimulationJobSpec) -> list[Json]:
    """The `envFrom` of a container that reads or writes storage: never of the user's stack.

    A key `AWS_REGION` arrives under the prefix, and bagpipe.storage takes over those names
    that it knows: a Secret must not set LD_PRELOAD or PYTHONPATH beside the driver's rights.
    A Secret that is missing keeps the container from starting, which the job's status reports.
    """
    return [
        {"prefix": f"{SECRET_PREFIX}{index}_", "secretRef": {"name": name}}
        for index, name in enumerate(spec.storage.secrets)
    ]


def host_environment(settings: Settings) -> list[Json]:
    """The servers that the container's storage may be on. Where the list is empty, no variable.

    What a Secret says of servers is known in the pod alone, so it is checked there.
    """
    if not settings.storage_hosts:
        return []
    return [{"name": storage_hosts.VARIABLE, "value": ",".join(settings.storage_hosts)}]
