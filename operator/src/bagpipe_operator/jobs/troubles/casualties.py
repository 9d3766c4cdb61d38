"""Executors that were ended from outside: for lack of memory, by an eviction, with their node.

Pure. Spark replaces such an executor within seconds, so its end is reported for a minute after it,
also when its pod is gone already.
"""

from collections.abc import Iterable
from datetime import datetime

from bagpipe_operator.api import names, reasons
from bagpipe_operator.jobs.pod_view import ContainerView, PodView
from bagpipe_operator.jobs.troubles.trouble import Trouble, sentence

REPORTED_SECONDS = 60.0

# Kubernetes' reasons of the condition DisruptionTarget that mean an eviction, in words.
EVICTIONS = {
    "EvictionByEvictionAPI": "through the eviction API, as `kubectl drain` does",
    "PreemptionByScheduler": "for a pod of a higher priority",
    "TerminationByKubelet": "by its node",
}
# Those of them that say nothing of the pod. A node may be tainted because a pod has starved it.
VOLUNTARY = frozenset({"EvictionByEvictionAPI", "PreemptionByScheduler"})
_OUT_OF_MEMORY = "OOMKilled"


def casualties(pods: Iterable[PodView], gone: Iterable[PodView], now: datetime) -> list[Trouble]:
    """What happened to executors in the last minute, none of it lasting but one that recurs."""
    found: list[Trouble] = []
    for pod in pods:
        found += [*_of_memory(pod, now), *_of_node(pod), *_of_eviction(pod, now)]
    for pod in gone:
        if pod.role == names.ROLE_EXECUTOR:
            found += [*_of_memory(pod, now), *_of_eviction(pod, now)]
    return found


def _of_memory(pod: PodView, now: datetime) -> list[Trouble]:
    if pod.role != names.ROLE_EXECUTOR:
        return []
    return [
        Trouble(
            reasons.EXECUTOR_OUT_OF_MEMORY,
            pod.name,
            f"Container {container.name} in pod {pod.name} was ended for lack of memory. "
            f"{_advice(container.name)}",
            container.name,
            # Restarted again and again: it will not get better.
            lasting=container.waiting_reason == "CrashLoopBackOff",
        )
        for container in pod.containers
        if container.reason == _OUT_OF_MEMORY and _matters(container, now)
    ]


def _matters(container: ContainerView, now: datetime) -> bool:
    return bool(container.waiting_reason) or _recent(container.ended_at, now)


def _advice(container: str) -> str:
    if names.is_stack(container):
        return "Raise spec.stack.resources.limits.memory."
    if container == names.CONTAINER_AGENT:
        return "Its size is Bagpipe's own: please report it."
    return "Raise spec.spark.executor.resources.memory."


def _of_node(pod: PodView) -> list[Trouble]:
    if not pod.node_silent or pod.ended:
        return []
    message = (
        f"Node {pod.node} of pod {pod.name} does not answer. What ran there is run again elsewhere."
    )
    return [Trouble(reasons.NODE_LOST, pod.name, message, lasting=False)]


def _of_eviction(pod: PodView, now: datetime) -> list[Trouble]:
    """An executor that was taken away, or a driver that is being; its end is ending_of's."""
    if pod.role != names.ROLE_EXECUTOR:
        return _of_leaving(pod)
    if pod.disruption is None:
        if pod.reason != "Evicted":
            return []
        return [_evicted(pod, f"was evicted: {sentence(pod.message)}")]
    if not _recent(pod.disruption.at, now):
        return []
    if pod.disruption.reason in EVICTIONS:
        by = EVICTIONS[pod.disruption.reason]
        return [_evicted(pod, f"was evicted {by}: {sentence(pod.disruption.message)}")]
    message = (
        f"Pod {pod.name} was taken away ({pod.disruption.reason}): "
        f"{sentence(pod.disruption.message)} Spark replaces it."
    )
    return [Trouble(reasons.NODE_LOST, pod.name, message, lasting=False)]


def _of_leaving(driver: PodView) -> list[Trouble]:
    """A driver that has its grace period: what is to come is known already."""
    if driver.disruption is None or driver.ended:
        return []
    by = EVICTIONS.get(driver.disruption.reason)
    what = f"is being evicted {by}" if by else f"is taken away ({driver.disruption.reason})"
    message = (
        f"The driver's pod {driver.name} {what}: {sentence(driver.disruption.message)} "
        "Another takes over once it has ended."
    )
    reason = reasons.DRIVER_EVICTED if by else reasons.DRIVER_LOST
    return [Trouble(reason, driver.name, message, lasting=False)]


def _evicted(pod: PodView, what: str) -> Trouble:
    message = f"Pod {pod.name} {what} Spark replaces it."
    return Trouble(reasons.EXECUTOR_EVICTED, pod.name, message, lasting=False)


def _recent(at: datetime | None, now: datetime) -> bool:
    # Clocks of nodes differ by seconds, so a moment to come is recent too.
    return at is None or (now - at).total_seconds() < REPORTED_SECONDS
