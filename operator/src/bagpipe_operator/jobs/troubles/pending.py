"""What Kubernetes says of a pod that waits only in Events and in the pod's claims. Pure.

A volume that does not mount leaves the pod's own status at ContainerCreating, and a claim that
waits for its volume may leave it without any condition at all. Of an image that can't be pulled
the kubelet writes an Event at once, and the pod's status when it looks at the pod again: after 10
to 15 s (its backOffPeriod and jitter), unless something else happens to the pod.
"""

import re
from collections.abc import Iterable
from datetime import UTC, datetime

from bagpipe_operator.api import readings, reasons
from bagpipe_operator.api.objects import Json
from bagpipe_operator.jobs.pod_view import PodView
from bagpipe_operator.jobs.troubles.diagnose import of_image, of_missing
from bagpipe_operator.jobs.troubles.trouble import Trouble, sentence

_MOUNT = frozenset({"FailedMount", "FailedAttachVolume", "FailedMapVolume"})
_SANDBOX = frozenset({"FailedCreatePodSandBox", "FailedCreatePodContainer"})
# After one of these the kubelet is past volumes and sandbox.
_STARTING = frozenset({"Pulling", "Pulled", "Created", "Started"})
_PULL = re.compile(r"Failed to pull image\b")
# Without a brace in the name: text that is all beginnings is read once, and not once for each.
_CONTAINER = re.compile(r"\.(?:initContainers|containers)\{([^{}]+)\}$")
_LONG_AGO = datetime(1970, 1, 1, tzinfo=UTC)
_UNBOUND = "unbound immediate PersistentVolumeClaims"


def awaits_a_claim(pod: PodView) -> bool:
    """Whether one of the pod's claims may be what it waits for."""
    if pod.node or pod.deleting or pod.phase != "Pending" or not pod.claims:
        return False
    return not pod.unschedulable or _UNBOUND in pod.unschedulable


def awaits_its_node(pod: PodView) -> bool:
    """Whether the pod has a node, and nothing in its status says why it does not start there."""
    if not pod.node or pod.deleting or pod.phase != "Pending":
        return False
    # One that runs or has ended waits for nothing.
    quiet = {"", "ContainerCreating", "PodInitializing"}
    return all(container.waiting_reason in quiet for container in pod.containers)


def of_events(pod: PodView, events: Iterable[Json]) -> Trouble | None:
    """The trouble that the latest Event reports; None once a container of the pod was started."""
    relevant = [
        e for e in events if e.get("reason") in _MOUNT | _SANDBOX | _STARTING or _says_pull(e)
    ]
    # Events have whole seconds, and a pull is begun before it fails.
    last = max(relevant, key=lambda e: (last_seen(e), _says_pull(e)), default=None)
    if last is None or last["reason"] in _STARTING:
        return None
    reported = sentence(last.get("message") or "")
    if _says_pull(last):
        return _of_pull(pod, last, reported)
    if last["reason"] in _SANDBOX:
        message = f"Node {pod.node} can't set up pod {pod.name} ({last['reason']}): {reported}"
        return Trouble(reasons.CONTAINER_NOT_STARTING, pod.name, message, lasting=False)
    message = f"A volume of pod {pod.name} does not mount on node {pod.node}: {reported}"
    missing = of_missing(pod, reported, message)
    return missing or Trouble(reasons.VOLUME_NOT_MOUNTED, pod.name, message, lasting=False)


def _says_pull(event: Json) -> bool:
    reported = event.get("message") or ""
    return event.get("reason") == "Failed" and _PULL.match(reported) is not None


def _of_pull(pod: PodView, event: Json, reported: str) -> Trouble | None:
    """The trouble that the pod's status will report too, with the same key."""
    found = _CONTAINER.search((event.get("involvedObject") or {}).get("fieldPath") or "")
    container = pod.container(found[1]) if found else None
    return of_image(pod, container, "ErrImagePull", reported) if container else None


def of_claim(
    pod: PodView, claim: str, found: Json | None, events: Iterable[Json]
) -> Trouble | None:
    """The trouble of a claim as the API server has it (None: not at all); None when it is bound."""
    if found is None:
        return Trouble(
            reasons.VOLUME_MISSING,
            pod.name,
            f"Pod {pod.name} can't start: there is no PersistentVolumeClaim {claim} in namespace "
            f"{pod.namespace}. Create it, or correct the pvc:// URIs, and create the job again.",
        )
    phase = (found.get("status") or {}).get("phase") or "Pending"
    if phase == "Bound":
        return None
    last = max(events, key=last_seen, default=None)
    reported = sentence(last.get("message") or "") if last else "No Event states why."
    message = (
        f"Pod {pod.name} waits for PersistentVolumeClaim {claim}, which is {phase} and not bound "
        f"to a volume: {reported} It starts as soon as the claim is bound."
    )
    return Trouble(reasons.VOLUME_PENDING, pod.name, message, lasting=phase == "Lost")


def last_seen(event: Json) -> datetime:
    """When an Event was last reported, in whichever of the two formats it was written.

    Long ago for one with a moment that nothing but malice writes, such as one of the year 0.
    """
    series = event.get("series") or {}
    text = (
        series.get("lastObservedTime")
        or event.get("lastTimestamp")
        or event.get("eventTime")
        or event["metadata"]["creationTimestamp"]
    )
    return readings.moment(text) or _LONG_AGO


def refused_executor(
    job: str, namespace: str, status: int, reported: str, alone: bool
) -> Trouble | None:
    """What it means that the API server would not let Spark create an executor now.

    `alone` says that no executor is there, so that the job can't go on without a person. None for
    a fault of the question itself.
    """
    pod = f"{job}'s executors"
    if status == 403 and "exceeded quota" in reported:
        message = (
            f"The namespace's quota has no room for more executors: {sentence(reported)} "
            "They start as soon as it has; or lower spec.spark.executors or their resources."
        )
        return Trouble(reasons.QUOTA_EXCEEDED, pod, message, lasting=False)
    if status not in {403, 422} or "being terminated" in reported:
        return None
    message = f"Namespace {namespace} refuses the executors' pods: {sentence(reported)}"
    return Trouble(reasons.EXECUTORS_REFUSED, pod, message, lasting=alone)


def unanswered_executor(job: str, namespace: str, reported: str) -> Trouble:
    """What it means that nobody answers the question: Spark's own creations wait as long."""
    message = (
        f"The API server gives no answer about executors' pods in namespace {namespace}, as where "
        f"an admission webhook is down or hangs: {sentence(reported)} They start as soon as it "
        "does."
    )
    return Trouble(reasons.EXECUTORS_REFUSED, f"{job}'s executors", message, lasting=False)
