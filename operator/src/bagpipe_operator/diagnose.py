"""Why pods do not start or were ended: the kubelet's and the scheduler's words, made a sentence.

Pure. Each trouble says whether only a person can mend it, so that the job had better end.
"""

import re
from collections.abc import Iterable
from dataclasses import dataclass

from bagpipe_operator import names, reasons
from bagpipe_operator.view import ContainerView, PodView

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
_MISSING_CLAIM = re.compile(r'persistentvolumeclaim "([^"]+)" not found')


@dataclass(frozen=True)
class Trouble:
    """Something that keeps a pod from its work."""

    reason: str
    pod: str
    message: str
    container: str = ""
    lasting: bool = True  # only a person can mend it

    @property
    def key(self) -> tuple[str, str, str]:
        """What stays the same while the kubelet's wording changes."""
        return (self.reason, self.pod, self.container)


def troubles(pods: Iterable[PodView]) -> list[Trouble]:
    """All troubles of a job's pods, the lasting ones first."""
    found = [t for pod in pods if not pod.deleting for t in _of_pod(pod)]
    # Where one executor has the stack running, the image exists: another node may yet get it.
    if any(_stack_runs(pod) for pod in pods):
        found = [_passing(t) if t.container else t for t in found]
    return sorted(found, key=lambda t: not t.lasting)


def _of_pod(pod: PodView) -> list[Trouble]:
    if pod.ended:
        return _of_ended(pod)
    if pod.unschedulable:
        return [_of_scheduling(pod)]
    found: list[Trouble] = []
    for container in pod.containers:
        found += _of_waiting(pod, container)
        found += _of_memory(pod, container)
    return found


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
        f"Pod {pod.name} has no node yet: {_clean(pod.unschedulable)} "
        "It starts as soon as a node has room.",
        lasting=False,
    )


def _of_waiting(pod: PodView, container: ContainerView) -> list[Trouble]:
    why = container.waiting_reason
    said = _clean(container.message or why)
    if why in _IMAGE:
        reason = _IMAGE_REASONS.get((pod.role, container.name), reasons.CONTAINER_NOT_STARTING)
        message = (
            f"Image {container.image} of container {container.name} in pod {pod.name} can't be "
            f"had ({why}): {said} {_advice(container.name)}"
        )
        return [Trouble(reason, pod.name, message, container.name)]
    if why in _START:
        message = (
            f"Container {container.name} (image {container.image}) in pod {pod.name} does not "
            f"start ({why}): {said}"
        )
        return [Trouble(reasons.CONTAINER_NOT_STARTING, pod.name, message, container.name)]
    return []


def _advice(container: str) -> str:
    if container == names.CONTAINER_STACK:
        return "Correct spec.stack.image or make it pullable, and create the job again."
    return (
        "It is Bagpipe's own image: an administrator sets it by images.registry and images.tag of "
        "the Helm chart, or loads it into the nodes."
    )


def _of_memory(pod: PodView, container: ContainerView) -> list[Trouble]:
    if container.reason != "OOMKilled" or pod.role != names.ROLE_EXECUTOR:
        return []
    where = (
        "spec.stack.resources.limits.memory"
        if container.name == names.CONTAINER_STACK
        else "spec.spark.executor.resources.memory"
    )
    message = (
        f"Container {container.name} in pod {pod.name} was ended for lack of memory. Raise {where}."
    )
    return [
        Trouble(reasons.EXECUTOR_OUT_OF_MEMORY, pod.name, message, container.name, lasting=False)
    ]


def _of_ended(pod: PodView) -> list[Trouble]:
    if pod.role != names.ROLE_EXECUTOR:
        return []
    if pod.reason == "Evicted":
        message = f"Pod {pod.name} was evicted: {_clean(pod.message)} Spark replaces it."
        return [Trouble(reasons.EXECUTOR_EVICTED, pod.name, message, lasting=False)]
    return [t for container in pod.containers for t in _of_memory(pod, container)]


def _stack_runs(pod: PodView) -> bool:
    stack = pod.container(names.CONTAINER_STACK)
    return pod.role == names.ROLE_EXECUTOR and stack is not None and stack.running


def _passing(trouble: Trouble) -> Trouble:
    return Trouble(trouble.reason, trouble.pod, trouble.message, trouble.container, lasting=False)


def _clean(text: str) -> str:
    """One line that ends as a sentence."""
    line = " ".join(text.split())[:500].rstrip()
    return line if not line or line.endswith((".", "!", "?")) else line + "."
