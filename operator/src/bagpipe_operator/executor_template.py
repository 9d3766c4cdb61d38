"""The executors' pod template, which the driver hands to Spark. Pure.

Spark fills in its own container (image, arguments, resources), the name, the owner and the
restart policy; the rest of the pod is said here.
"""

from bagpipe.spec import SimulationJobSpec
from bagpipe_operator import names
from bagpipe_operator.driver_pod import RESTRICTED_CONTAINER
from bagpipe_operator.settings import Settings
from bagpipe_operator.view import JobView, Json
from bagpipe_operator.volumes import claim_mounts, claim_volumes

AGENT = f"{names.SHARED_PATH}/bin/bagpipe-agent"

# The agent's binary, FIFOs and locks; bags are in the agent's own memory, not here.
SHARED_SIZE = "64Mi"

# Making the FIFOs takes milliseconds; two minutes allow for a node that is very busy.
PROBE_LIMIT = 120

_SHARED_MOUNT: Json = {"name": "shared", "mountPath": names.SHARED_PATH}


def executor_template(
    job: JobView, spec: SimulationJobSpec, attempt: int, settings: Settings
) -> Json:
    """The manifest that becomes executor.yaml."""
    return {
        "apiVersion": "v1",
        "kind": "Pod",
        "metadata": {
            "labels": names.labels(job.name, job.uid, names.ROLE_EXECUTOR, attempt),
        },
        "spec": {
            "restartPolicy": "Never",
            # Neither Spark's executor nor the user's code has any business with the API server.
            "automountServiceAccountToken": False,
            "enableServiceLinks": False,
            "securityContext": {
                "fsGroup": names.BAGPIPE_UID,
                "fsGroupChangePolicy": "OnRootMismatch",
                "seccompProfile": {"type": "RuntimeDefault"},
            },
            "initContainers": [_agent(settings), _stack(spec)],
            "containers": [
                {
                    "name": names.CONTAINER_SPARK,
                    "image": settings.spark_image,
                    "imagePullPolicy": settings.image_pull_policy,
                    "securityContext": RESTRICTED_CONTAINER,
                    "volumeMounts": [_SHARED_MOUNT, *claim_mounts(spec)],
                }
            ],
            "volumes": [
                {"name": "shared", "emptyDir": {"medium": "Memory", "sizeLimit": SHARED_SIZE}},
                *claim_volumes(spec),
            ],
        },
    }


def _agent(settings: Settings) -> Json:
    """Copies the agent's binary to where the stack's container sees it, and ends."""
    return {
        "name": names.CONTAINER_AGENT,
        "image": settings.agent_image,
        "imagePullPolicy": settings.image_pull_policy,
        "command": ["/bagpipe-agent", "install", names.SHARED_PATH],
        "resources": {
            "requests": {"cpu": "10m", "memory": "32Mi"},
            "limits": {"memory": "128Mi"},
        },
        "securityContext": RESTRICTED_CONTAINER,
        "volumeMounts": [_SHARED_MOUNT],
    }


def _stack(spec: SimulationJobSpec) -> Json:
    """The user's image as a native sidecar: started before Spark, ended after it.

    It keeps the image's own user: robots' images often run as root, and are to run unmodified.
    """
    stack = spec.stack
    return {
        "name": names.CONTAINER_STACK,
        "image": stack.image,
        "imagePullPolicy": stack.image_pull_policy,
        "restartPolicy": "Always",
        "command": [
            AGENT, "serve", "--shared", names.SHARED_PATH, "--slots", str(spec.spark.slots),
        ],
        "startupProbe": {
            "exec": {"command": [AGENT, "ready", "--shared", names.SHARED_PATH]},
            "periodSeconds": 1,
            "timeoutSeconds": 5,
            "failureThreshold": PROBE_LIMIT,
        },
        "resources": stack.resources,
        "securityContext": {
            "allowPrivilegeEscalation": False,
            "seccompProfile": {"type": "RuntimeDefault"},
        },
        "volumeMounts": [_SHARED_MOUNT],
    }  # fmt: skip
