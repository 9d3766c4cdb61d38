"""The volume claims that a job's URIs name, as volumes and mounts of its pods."""

from bagpipe.spec import SimulationJobSpec, claims
from bagpipe_operator import names
from bagpipe_operator.view import Json


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
