"""The pod through which results on a claim are read. Pure: a manifest, and what keeps one waiting.

Its image is that of the job's driver, which the cluster has: it ran there, under the same rules for
images, and has Python. It mounts the claim as the driver did, with the same groups, but read-only.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from importlib import resources
from uuid import uuid4

from bagpipe.cli.cluster.state import Json

CONTAINER = "pull"
MOUNT = "/claim"
_PROGRAM = "BAGPIPE_PULL"
COMMAND = ["python3", "-c", f"import os; exec(os.environ['{_PROGRAM}'])"]
# The first process of a container gets no SIGTERM that it does not handle.
_WAITS = (
    "import signal, sys, time; signal.signal(signal.SIGTERM, lambda *_: sys.exit());"
    " time.sleep({seconds})"
)
# What the image's own user is, where the cluster gives its pods none (OpenShift does).
_USER = 10001
_GROUPS = ("fsGroup", "supplementalGroups", "seLinuxOptions")
_ORDINARY = frozenset({"ContainerCreating", "PodInitializing"})


@dataclass(frozen=True)
class Claimed:
    """Results on a claim: its name, and their folder below its root."""

    claim: str
    folder: str


def claimed(uri: str) -> Claimed | None:
    """Where pvc://claim/folder leads; None for what leads nowhere on a claim."""
    claim, _, folder = uri.removeprefix("pvc://").rstrip("/").partition("/")
    parts = folder.split("/")
    if not uri.startswith("pvc://") or not claim or any(p in ("", ".", "..") for p in parts):
        return None
    return Claimed(claim, folder)


def manifest(job: Json, driver: Json, image: str, claim: str, seconds: float) -> Json:
    """A pod for one pull, which goes with its job, and ends `seconds` after it began at the latest.

    `driver` is a pod of a driver, or empty where none is left; `image` is empty for its image.
    """
    spec = driver.get("spec") or {}
    container: Json = next(iter(spec.get("containers") or []), {})
    whole = max(1, round(seconds))
    kept = {
        key: spec[key]
        for key in ("nodeSelector", "tolerations", "imagePullSecrets", "runtimeClassName")
        if spec.get(key)
    }
    if of_nodes := (spec.get("affinity") or {}).get("nodeAffinity"):
        kept["affinity"] = {"nodeAffinity": of_nodes}
    return {
        "apiVersion": "v1",
        "kind": "Pod",
        "metadata": {
            "name": f"bagpipe-pull-{uuid4().hex[:12]}",
            "labels": {
                "app.kubernetes.io/name": "bagpipe-pull",
                "app.kubernetes.io/managed-by": "bagpipe-cli",
            },
            "annotations": {"sidecar.istio.io/inject": "false"},
            "ownerReferences": [_owner(job)],
        },
        "spec": {
            "restartPolicy": "Never",
            "activeDeadlineSeconds": whole,
            "terminationGracePeriodSeconds": 1,
            "automountServiceAccountToken": False,
            "enableServiceLinks": False,
            "securityContext": _pod_security(spec),
            **kept,
            "volumes": [{"name": "claim", "persistentVolumeClaim": {"claimName": claim}}],
            "containers": [_container(container, image, whole)],
        },
    }


def _container(driver: Json, image: str, seconds: int) -> Json:
    program = resources.files("bagpipe.cli.pulling").joinpath("sender.py").read_text()
    own = driver.get("securityContext") or {}
    user = {key: own[key] for key in ("runAsUser", "runAsGroup") if own.get(key)}
    return {
        "name": CONTAINER,
        "image": image or driver.get("image"),
        "imagePullPolicy": driver.get("imagePullPolicy") or "IfNotPresent",
        "command": ["python3", "-c", _WAITS.format(seconds=seconds)],
        "env": [{"name": _PROGRAM, "value": program}],
        "resources": {
            "requests": {"cpu": "50m", "memory": "64Mi"},
            "limits": {"cpu": "1", "memory": "256Mi"},
        },
        "securityContext": {
            "allowPrivilegeEscalation": False,
            "capabilities": {"drop": ["ALL"]},
            "readOnlyRootFilesystem": True,
            "runAsNonRoot": True,
            "seccompProfile": {"type": "RuntimeDefault"},
            **(user if driver else {"runAsUser": _USER, "runAsGroup": _USER}),
        },
        "volumeMounts": [{"name": "claim", "mountPath": MOUNT, "readOnly": True}],
    }


def _pod_security(spec: Json) -> Json:
    """The driver's groups, by which its volumes are readable; the volume has them already."""
    found = spec.get("securityContext") or {}
    groups = {key: found[key] for key in _GROUPS if found.get(key)}
    if not spec:
        groups = {"fsGroup": _USER}
    return {
        "fsGroupChangePolicy": "OnRootMismatch",
        "runAsNonRoot": True,
        "seccompProfile": {"type": "RuntimeDefault"},
        **groups,
    }


def _owner(job: Json) -> Json:
    """Its job, which nobody has to ask the deletion of: the pod is swept away with it."""
    meta = job["metadata"]
    return {
        "apiVersion": job["apiVersion"],
        "kind": job["kind"],
        "name": meta["name"],
        "uid": meta["uid"],
    }


def runs(pod: Json) -> bool:
    """Whether the pod's own container runs."""
    return any("running" in (status.get("state") or {}) for status in _own(pod))


def end_of(pod: Json) -> str:
    """Why the pod has ended; empty for one that has not."""
    status = pod.get("status") or {}
    if status.get("phase") not in ("Failed", "Succeeded"):
        return ""
    words = [status.get("reason"), status.get("message")]
    for container in _own(pod):
        ended = (container.get("state") or {}).get("terminated") or {}
        words += [ended.get("reason"), ended.get("message")]
    return ": ".join(str(word) for word in words if word) or "it ended"


def waits_for(pod: Json) -> str:
    """What the pod's status says that keeps it from running; empty where it says nothing."""
    for condition in (pod.get("status") or {}).get("conditions") or []:
        if condition.get("type") == "PodScheduled" and condition.get("status") == "False":
            return f"no node takes it: {condition.get('message') or condition.get('reason')}"
    for container in _own(pod):
        waiting = (container.get("state") or {}).get("waiting") or {}
        if waiting and waiting.get("reason") not in _ORDINARY:
            words = [waiting.get("reason"), waiting.get("message")]
            return ": ".join(str(word) for word in words if word)
    return ""


def _own(pod: Json) -> Iterator[Json]:
    for status in (pod.get("status") or {}).get("containerStatuses") or []:
        if status.get("name") == CONTAINER:
            yield status
