"""What driver and executor pods have in common: the user's settings, and the walls around them.

Pure. Everything meets Pod Security's level "restricted"; what a job may loosen of its stack is in
`stack_security` alone.
"""

from collections.abc import Sequence

from pydantic import BaseModel

from bagpipe.pod_spec import PodSettings, SparkMount, StackMount, StackSecurity
from bagpipe_operator.api import names
from bagpipe_operator.api.objects import Json

RESTRICTED_CONTAINER: Json = {
    "allowPrivilegeEscalation": False,
    "capabilities": {"drop": ["ALL"]},
    "readOnlyRootFilesystem": True,
    "runAsNonRoot": True,
    "runAsUser": names.BAGPIPE_UID,
    "runAsGroup": names.BAGPIPE_UID,
    "seccompProfile": {"type": "RuntimeDefault"},
}

# Kubernetes waits five minutes before it gives up the pods of a node that it can't reach; what
# they do is safe to repeat, so half a minute is enough.
LOST_NODE_TOLERATIONS: list[Json] = [
    {
        "key": f"node.kubernetes.io/{taint}",
        "operator": "Exists",
        "effect": "NoExecute",
        "tolerationSeconds": 30,
    }
    for taint in ("not-ready", "unreachable")
]

# The root file system is read-only: Spark, Python and the JVM write here.
SCRATCH_VOLUMES: list[Json] = [
    {"name": "bagpipe-tmp", "emptyDir": {}},
    {"name": "bagpipe-home", "emptyDir": {}},
]
SPARK_SCRATCH_MOUNTS: list[Json] = [
    {"name": "bagpipe-tmp", "mountPath": "/tmp"},  # noqa: S108 - an emptyDir of this pod alone
    {"name": "bagpipe-home", "mountPath": "/home/bagpipe"},
]

ARCHITECTURE_LABEL = "kubernetes.io/arch"

# A user that no image has: the stack shares no files with Spark but the pipes.
STACK_UID = 65532
STACK_HOME = "/bagpipe/home"

# What a pod's automatic token volume holds, but in the driver's container alone. The seconds are
# those of the automatic volume too: the API server then honours the token for a year, which Spark
# needs, since it reads the file once.
TOKEN_VOLUME: Json = {
    "name": "bagpipe-token",
    "projected": {
        "sources": [
            {"serviceAccountToken": {"path": "token", "expirationSeconds": 3607}},
            {
                "configMap": {
                    "name": "kube-root-ca.crt",
                    "items": [{"key": "ca.crt", "path": "ca.crt"}],
                }
            },
        ]
    },
}
TOKEN_MOUNT: Json = {
    "name": "bagpipe-token",
    "mountPath": "/var/run/secrets/kubernetes.io/serviceaccount",
    "readOnly": True,
}


def plain(model: BaseModel) -> Json:
    """A part of the spec as Kubernetes writes it, without the fields that are not set."""
    return model.model_dump(mode="json", by_alias=True, exclude_none=True)


def metadata(
    pod: PodSettings, labels: dict[str, str], annotations: dict[str, str] | None = None
) -> Json:
    """The user's labels and annotations.

    Of two labels with one name ours counts, of two annotations the user's.
    """
    found: Json = {"labels": pod.labels | labels}
    if noted := (annotations or {}) | pod.annotations:
        found["annotations"] = noted
    return found


def placement(pod: PodSettings, labels: dict[str, str], architecture: str) -> Json:
    """Where the pods run and by whose leave.

    `labels` are those of the job's pods of this role. `architecture` is the nodes' unless the
    user names one; empty means any.
    """
    images = {ARCHITECTURE_LABEL: architecture} if architecture else {}
    found: Json = {
        "nodeSelector": images | pod.node_selector,
        "affinity": dict(pod.affinity),
        "topologySpreadConstraints": [
            plain(rule) | {"labelSelector": {"matchLabels": labels}}
            for rule in pod.topology_spread_constraints
        ],
        "priorityClassName": pod.priority_class_name,
        "runtimeClassName": pod.runtime_class_name,
        "imagePullSecrets": [plain(secret) for secret in pod.image_pull_secrets],
        "resourceClaims": [plain(claim) for claim in pod.resource_claims],
    }
    stated = {key: value for key, value in found.items() if value}
    tolerations = [plain(toleration) for toleration in pod.tolerations]
    return {"tolerations": [*LOST_NODE_TOLERATIONS, *tolerations], **stated}


def restricted(fixed_users: bool) -> Json:
    """The securityContext of Bagpipe's own containers."""
    if fixed_users:
        return RESTRICTED_CONTAINER
    return {k: v for k, v in RESTRICTED_CONTAINER.items() if k not in {"runAsUser", "runAsGroup"}}


def groups(pod: PodSettings, fixed_users: bool) -> Json:
    """The pod's securityContext, with the groups that volumes need."""
    # Volumes that know groups become writable for Bagpipe's containers by this.
    ours = {"fsGroup": names.BAGPIPE_UID} if fixed_users else {}
    return {
        **ours,
        "fsGroupChangePolicy": "OnRootMismatch",
        "seccompProfile": {"type": "RuntimeDefault"},
        **plain(pod.security_context),
    }


def own_volumes(pod: PodSettings) -> list[Json]:
    """The user's volumes."""
    return [plain(volume) for volume in pod.volumes]


def own_mounts(mounts: Sequence[SparkMount] | Sequence[StackMount]) -> list[Json]:
    """The user's mounts of one container."""
    return [plain(mount) for mount in mounts]


def as_the_image_says(security: StackSecurity) -> bool:
    """Whether the stack runs as the user of its image, who may be root."""
    return security.run_as_non_root is False and security.run_as_user is None


def stack_security(security: StackSecurity, fixed_users: bool) -> Json:
    """The stack's securityContext: restricted, but for what the job loosens."""
    found: Json = {
        "allowPrivilegeEscalation": False,
        "capabilities": {"drop": ["ALL"]},
        "readOnlyRootFilesystem": True,
        "runAsNonRoot": True,
        "seccompProfile": {"type": "RuntimeDefault"},
    }
    if not as_the_image_says(security) and (fixed_users or security.run_as_user is not None):
        user = STACK_UID if security.run_as_user is None else security.run_as_user
        found |= {"runAsUser": user, "runAsGroup": user}
    stated = plain(security)
    if security.capabilities.drop is None:
        del stated["capabilities"]
    return found | stated
