"""Why pods do not start: the kubelet's and the scheduler's words, made a sentence.

Pure. Each trouble says whether only a person can mend it, so that the job had better end.
"""

import re
from collections.abc import Iterable
from datetime import datetime

from bagpipe_operator.api import names, reasons
from bagpipe_operator.jobs.pod_view import ContainerView, PodView
from bagpipe_operator.jobs.troubles.casualties import casualties
from bagpipe_operator.jobs.troubles.trouble import Trouble, sentence

# The words of kubelet and container runtime for "the image is not there".
_IMAGE = frozenset(
    {
        "ErrImagePull",
        "ImagePullBackOff",
        "ErrImageNeverPull",
        "InvalidImageName",
        "ErrRegistryUnavailable",
        "ImageInspectError",
    }
)
# The words for "the image is there, but the container does not come up".
_START = frozenset(
    {
        "CreateContainerConfigError",
        "CreateContainerError",
        "RunContainerError",
        "CrashLoopBackOff",
        "PostStartHookError",
    }
)
_IMAGE_REASONS = {
    (names.ROLE_DRIVER, names.CONTAINER_DRIVER): reasons.DRIVER_IMAGE_UNAVAILABLE,
    (names.ROLE_EXECUTOR, names.CONTAINER_AGENT): reasons.AGENT_IMAGE_UNAVAILABLE,
    (names.ROLE_EXECUTOR, names.CONTAINER_STACK): reasons.STACK_IMAGE_UNAVAILABLE,
    (names.ROLE_EXECUTOR, names.CONTAINER_SPARK): reasons.EXECUTOR_IMAGE_UNAVAILABLE,
}
_MISSING = {
    "Secret": (
        re.compile(r'secret "([^"]+)" not found'),
        reasons.SECRET_MISSING,
        ", or correct spec.storage.secrets, and create the job again.",
    ),
    "ConfigMap": (
        re.compile(r'configmap "([^"]+)" not found'),
        reasons.CONFIG_MAP_MISSING,
        ", or, where it was the job's own, create the job again.",
    ),
}
_MISSING_CLAIM = re.compile(r'persistentvolumeclaim "([^"]+)" not found')


def troubles(
    pods: Iterable[PodView],
    now: datetime,
    gone: Iterable[PodView] = (),
    looked_up: Iterable[Trouble] = (),
) -> list[Trouble]:
    """All troubles of a job's pods, the lasting ones first.

    `gone` are the last pods that went, `looked_up` is what Lookout has found: it knows more than
    a pod's own status, so it comes first.
    """
    pods = list(pods)
    ended = casualties(pods, gone, now)
    explained = {(t.pod, t.container) for t in ended}
    found = [t for pod in pods if not (pod.deleting or pod.ended) for t in _of_pod(pod)]
    # A container that restarts for lack of memory "does not start" too; its cause says more.
    found = [*looked_up, *(t for t in found if (t.pod, t.container) not in explained), *ended]
    # Where one executor has the stack running, the image exists: another node may yet get it.
    if any(_stack_runs(pod) for pod in pods):
        found = [t.passing() if t.container else t for t in found]
    return sorted(found, key=lambda t: not t.lasting)


def _of_pod(pod: PodView) -> list[Trouble]:
    if pod.unschedulable:
        return [_of_scheduling(pod)]
    return [t for container in pod.containers for t in _of_waiting(pod, container)]


def _of_scheduling(pod: PodView) -> Trouble:
    missing = _MISSING_CLAIM.search(pod.unschedulable)
    if missing:
        claim = missing[1]
        return Trouble(
            reasons.VOLUME_MISSING,
            pod.name,
            f"Pod {pod.name} can't start: there is no PersistentVolumeClaim {claim} in namespace "
            f"{pod.namespace}. Create it, or correct the pvc:// URIs, and create the job again.",
        )
    return Trouble(
        reasons.UNSCHEDULABLE,
        pod.name,
        f"Pod {pod.name} has no node yet: {sentence(pod.unschedulable)} "
        "It starts as soon as a node has room.",
        lasting=False,
    )


def _of_waiting(pod: PodView, container: ContainerView) -> list[Trouble]:
    why = container.waiting_reason
    reported = sentence(container.message or why)
    if why in _IMAGE:
        return [of_image(pod, container, why, reported)]
    if why in _START:
        message = (
            f"Container {container.name} (image {container.image}) in pod {pod.name} does not "
            f"start ({why}): {reported}"
        )
        trouble = of_missing(pod, reported, message, container.name)
        return [
            trouble or Trouble(reasons.CONTAINER_NOT_STARTING, pod.name, message, container.name)
        ]
    return []


def of_image(pod: PodView, container: ContainerView, why: str, reported: str) -> Trouble:
    """The trouble of an image that the node can't have; `why` is the kubelet's word for it."""
    known = names.CONTAINER_STACK if names.is_stack(container.name) else container.name
    reason = _IMAGE_REASONS.get((pod.role, known), reasons.CONTAINER_NOT_STARTING)
    message = (
        f"Image {container.image} of container {container.name} in pod {pod.name} can't be "
        f"had ({why}): {reported} {_advice(container.name)}"
    )
    return Trouble(reason, pod.name, message, container.name)


def of_missing(pod: PodView, reported: str, message: str, container: str = "") -> Trouble | None:
    """The trouble of a Secret or ConfigMap that somebody says is not there; None for other words.

    Whoever asks for it may be a container's environment or a volume.
    """
    for kind, (words, reason, hint) in _MISSING.items():
        found = words.search(reported)
        if found:
            advice = f" Create {kind} {found[1]} in namespace {pod.namespace}{hint}"
            return Trouble(reason, pod.name, message + advice, container)
    return None


def _advice(container: str) -> str:
    if names.is_stack(container):
        field = "spec.stack.image" if container == names.CONTAINER_STACK else "the variant's image"
        return f"Correct {field} or make it pullable, and create the job again."
    return (
        "It is Bagpipe's own image: an administrator sets it by images.registry and images.tag of "
        "the Helm chart, or loads it into the nodes."
    )


def _stack_runs(pod: PodView) -> bool:
    stacks = [c for c in pod.containers if names.is_stack(c.name)]
    return pod.role == names.ROLE_EXECUTOR and bool(stacks) and all(c.running for c in stacks)
