"""Which pods hold a place (a node's, a quota's), and which give it back by themselves. Pure."""

from collections.abc import Iterable
from datetime import datetime

from bagpipe_operator.api import names
from bagpipe_operator.jobs.driver.ending import overdue
from bagpipe_operator.jobs.pod_view import PodView

# A native sidecar, or a mesh set to end with its pod, ends within seconds after the driver.
LINGER_SECONDS = 30.0
# The kubelet's word for a container that its runtime knows no more: no moment of its end, no log.
_LOST_CONTAINER = "ContainerStatusUnknown"


def living(pods: Iterable[PodView], now: datetime) -> tuple[PodView, ...]:
    """The pods that hold a place: their node's, their quota's, and what they mount.

    One that is being deleted holds it until it is gone: its volumes are taken down after its
    containers have ended. One that ended by itself is kept for its log and holds nothing.
    """
    holding = (pod for pod in pods if pod.deleting or not pod.ended)
    return tuple(pod for pod in holding if not overdue(pod, now))


def over(pod: PodView) -> bool:
    """Whether the pod's driver has ended; the phase of its pod follows in a moment."""
    driver = pod.container(names.CONTAINER_DRIVER)
    return driver is not None and driver.exit_code is not None


def lingers(pod: PodView, now: datetime) -> bool:
    """Whether a pod goes on without its driver: a container that somebody has put beside it runs.

    A service mesh's proxy that is no native sidecar does not end, and would keep the pod's place,
    its quota and its claims for ever.
    """
    driver = pod.container(names.CONTAINER_DRIVER)
    if driver is None or driver.exit_code is None or pod.ended or pod.deleting:
        return False
    if driver.ended_at is None:
        return driver.reason == _LOST_CONTAINER
    return (now - driver.ended_at).total_seconds() >= LINGER_SECONDS


def needs_stop(pod: PodView, now: datetime) -> bool:
    """Whether a pod that holds a place gives it back only when it is deleted."""
    return not over(pod) or lingers(pod, now)
