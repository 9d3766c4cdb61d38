"""Names that other parts rely on: the API, labels, containers, and how children are called."""

GROUP = "sim.bagpipe.io"
VERSION = "v1alpha1"
API_VERSION = f"{GROUP}/{VERSION}"
KIND = "SimulationJob"
PLURAL = "simulationjobs"

LABEL_JOB = f"{GROUP}/job"
LABEL_JOB_UID = f"{GROUP}/job-uid"
LABEL_ROLE = f"{GROUP}/role"
LABEL_ATTEMPT = f"{GROUP}/attempt"

ROLE_DRIVER = "driver"
ROLE_EXECUTOR = "executor"

CONTAINER_DRIVER = "driver"
CONTAINER_AGENT = "agent"
CONTAINER_STACK = "stack"
CONTAINER_SPARK = "spark"

PROGRESS_PORT = 8080
CONFIG_PATH = "/etc/bagpipe"
SHARED_PATH = "/bagpipe/shared"
VOLUMES_PATH = "/bagpipe/volumes"

# The uid and gid that Bagpipe's own images run as.
BAGPIPE_UID = 10001


def attempt_name(job: str, attempt: int) -> str:
    """The ConfigMap's name, and the stem of everything else of one attempt."""
    return f"{job}-{attempt}"


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


def owner_reference(job: str, uid: str) -> dict[str, object]:
    """Ties a child to its job, so that the garbage collector deletes it with the job.

    blockOwnerDeletion stays off: it would need the right to update finalizers.
    """
    return {
        "apiVersion": API_VERSION,
        "kind": KIND,
        "name": job,
        "uid": uid,
        "controller": True,
        "blockOwnerDeletion": False,
    }
