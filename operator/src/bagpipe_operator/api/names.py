"""Names that other parts rely on: the API, labels, containers, and how children are called."""

import hashlib
import json
from collections.abc import Mapping

GROUP = "sim.bagpipe.io"
VERSION = "v1alpha1"
API_VERSION = f"{GROUP}/{VERSION}"
KIND = "SimulationJob"
PLURAL = "simulationjobs"
SCHEDULE_KIND = "SimulationSchedule"
SCHEDULE_PLURAL = "simulationschedules"

# A job's spec.managedBy of the jobs that are the operator's, as those without one are.
MANAGER = f"{GROUP}/operator"

LABEL_JOB = f"{GROUP}/job"
LABEL_JOB_UID = f"{GROUP}/job-uid"
LABEL_ROLE = f"{GROUP}/role"
LABEL_ATTEMPT = f"{GROUP}/attempt"
LABEL_SCHEDULE = f"{GROUP}/schedule"
# On a driver's pod that waits for another job: what that one must have alike.
ANNOTATION_SHAPE = f"{GROUP}/shape"
ANNOTATION_SCHEDULED_AT = f"{GROUP}/scheduled-at"

# Kueue's own: pods with it wait for a place in the queue that it names.
LABEL_QUEUE = "kueue.x-k8s.io/queue-name"

ROLE_DRIVER = "driver"
ROLE_EXECUTOR = "executor"

CONTAINER_DRIVER = "driver"
CONTAINER_AGENT = "agent"
CONTAINER_STACK = "stack"
CONTAINER_SPARK = "spark"

PROGRESS_PORT = 8080
# Of the agent beside a job's image 0; the agent beside image n has this port + n.
METRICS_PORT = 9811
CONFIG_PATH = "/etc/bagpipe"
SHARED_PATH = "/bagpipe/shared"
VOLUMES_PATH = "/bagpipe/volumes"

# The uid and gid that Bagpipe's own images run as.
BAGPIPE_UID = 10001


def attempt_name(job: str, attempt: int) -> str:
    """The stem of the names of everything of one attempt."""
    return f"{job}-{attempt}"


def config_name(job: str, attempt: int, data: Mapping[str, str]) -> str:
    """The ConfigMap's name, which says what is in it.

    A job that waits for quota may be edited, and the chart upgraded: then it has another.
    """
    content = hashlib.sha256(json.dumps(data, sort_keys=True).encode()).hexdigest()
    return f"{attempt_name(job, attempt)}-{content[:10]}"


def driver_name(job: str, attempt: int) -> str:
    """The driver pod's name."""
    return f"{attempt_name(job, attempt)}-driver"


def labels(job: str, uid: str, role: str, attempt: int) -> dict[str, str]:
    """The labels by which the operator finds a job's pods again."""
    return {
        "app.kubernetes.io/managed-by": "bagpipe",
        LABEL_JOB: job,
        LABEL_JOB_UID: uid,
        LABEL_ROLE: role,
        LABEL_ATTEMPT: str(attempt),
    }


def stack_container(number: int) -> str:
    """The container of a job's image `number`; jobs without variants have number 0 alone."""
    return CONTAINER_STACK if number == 0 else f"{CONTAINER_STACK}-{number}"


def metrics_port_name(number: int) -> str:
    """The name of the port on which the agent beside image `number` serves its metrics."""
    return "metrics" if number == 0 else f"metrics-{number}"


def scraped(port: int) -> dict[str, str]:
    """What plain configurations of Prometheus find a pod by; the user may say otherwise."""
    return {
        "prometheus.io/scrape": "true",
        "prometheus.io/port": str(port),
        "prometheus.io/path": "/metrics",
    }


def is_stack(container: str) -> bool:
    """Whether a container of an executor holds an image of the user's."""
    return container == CONTAINER_STACK or container.startswith(f"{CONTAINER_STACK}-")


def selector(uid: str, role: str) -> dict[str, str]:
    """The labels that a job's pods of one role have in common, whatever the attempt."""
    return {LABEL_JOB_UID: uid, LABEL_ROLE: role}


def queue_label(queue: str | None) -> dict[str, str]:
    """The label by which Kueue takes a pod, or none."""
    return {LABEL_QUEUE: queue} if queue else {}


def owner_reference(owner: str, uid: str, kind: str = KIND) -> dict[str, object]:
    """Ties a child to its job or schedule: the garbage collector deletes it with its owner.

    blockOwnerDeletion stays off: it would need the right to update finalizers.
    """
    return {
        "apiVersion": API_VERSION,
        "kind": kind,
        "name": owner,
        "uid": uid,
        "controller": True,
        "blockOwnerDeletion": False,
    }
