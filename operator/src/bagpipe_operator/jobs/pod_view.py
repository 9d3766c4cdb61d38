"""A pod of a job, trimmed to what the operator decides on."""

from dataclasses import dataclass
from datetime import datetime
from itertools import islice

from bagpipe_operator.api import names, readings
from bagpipe_operator.api.objects import Json
from bagpipe_operator.cluster.large_objects import shape_of

# Of what the API server takes at any length from whoever may create pods, as much as is read. The
# largest pod of Bagpipe's has 16 variants' containers and a few more, and a handful of claims.
MOST_CONTAINERS, MOST_CLAIMS = 64, 20
# No claim can have a longer name, no image a longer reference; a driver's account is 4,096 bytes.
_LONGEST_CLAIM, _LONGEST_IMAGE, _LONGEST_TEXT = 253, 512, 4096


@dataclass(frozen=True)
class ContainerView:
    """One container's state; at most one of waiting_reason and exit_code is set."""

    name: str
    image: str = ""
    running: bool = False
    waiting_reason: str = ""
    exit_code: int | None = None
    reason: str = ""  # of the exit, now or the last one: OOMKilled, Error, Completed
    message: str = ""  # the kubelet's when waiting, the container's own when ended
    ended_at: datetime | None = None  # of the exit that `reason` is of


@dataclass(frozen=True)
class Disruption:
    """Who takes a pod away, from its condition DisruptionTarget."""

    reason: str  # EvictionByEvictionAPI, PreemptionByScheduler, DeletionByTaintManager, ...
    message: str
    at: datetime | None


@dataclass(frozen=True)
class PodView:
    """A pod of a job."""

    namespace: str
    name: str
    uid: str
    job_uid: str
    job: str  # its name, by a label that admission holds drivers' tokens to
    role: str
    attempt: int
    phase: str = "Pending"
    ip: str = ""
    gone_by: datetime | None = None  # when a pod that was deleted should be gone
    reason: str = ""
    message: str = ""
    unschedulable: str = ""  # the scheduler's message, as long as there is no node
    containers: tuple[ContainerView, ...] = ()
    resource_version: str = ""
    node: str = ""  # empty until the scheduler has found one
    claims: tuple[str, ...] = ()  # PersistentVolumeClaims that it mounts
    disruption: Disruption | None = None
    node_silent: bool = False  # the node does not report, whatever the pod is doing
    shape: str = ""  # of a driver that waits for another job: what that one must have alike

    @property
    def deleting(self) -> bool:
        """Whether it was deleted and is not gone yet."""
        return self.gone_by is not None

    @property
    def ended(self) -> bool:
        """Whether all its containers are over for good."""
        return self.phase in {"Succeeded", "Failed"}

    def container(self, name: str) -> ContainerView | None:
        """The container of that name, init containers included; None before the kubelet reports."""
        return next((c for c in self.containers if c.name == name), None)

    @classmethod
    def from_object(cls, pod: Json) -> "PodView":
        """Trims a pod as the API server sends it."""
        meta, status = pod["metadata"], pod.get("status") or {}
        labels = meta.get("labels") or {}
        attempt = labels.get(names.LABEL_ATTEMPT, "")
        statuses = [
            *(status.get("initContainerStatuses") or [])[:MOST_CONTAINERS],
            *(status.get("containerStatuses") or [])[:MOST_CONTAINERS],
        ]
        return cls(
            namespace=meta["namespace"],
            name=meta["name"],
            uid=meta["uid"],
            job_uid=labels.get(names.LABEL_JOB_UID, ""),
            job=labels.get(names.LABEL_JOB, ""),
            role=labels.get(names.LABEL_ROLE, ""),
            attempt=int(attempt) if attempt.isdecimal() else 0,
            phase=status.get("phase") or "Pending",
            ip=status.get("podIP") or "",
            gone_by=readings.moment(meta.get("deletionTimestamp")),
            reason=_text(status.get("reason")),
            message=_text(status.get("message")),
            unschedulable=_unschedulable(status),
            containers=tuple(_container(s) for s in statuses),
            resource_version=str(meta.get("resourceVersion") or ""),
            node=(pod.get("spec") or {}).get("nodeName") or "",
            claims=_claims(pod.get("spec") or {}),
            disruption=_disruption(status),
            node_silent=_node_silent(status),
            shape=shape_of(meta),
        )


def _unschedulable(status: Json) -> str:
    for condition in status.get("conditions") or []:
        if condition.get("type") == "PodScheduled" and condition.get("status") == "False":
            if condition.get("reason") == "SchedulingGated":
                return ""  # a queue holds it back, and nobody has looked for a node
            return _text(condition.get("message") or condition.get("reason") or "no node fits")
    return ""


def _claims(spec: Json) -> tuple[str, ...]:
    """The first ones; a longer name than a claim can have is none's."""
    sources = (v.get("persistentVolumeClaim") for v in spec.get("volumes") or [])
    claims = (source["claimName"] for source in sources if source)
    return tuple(islice((each for each in claims if len(each) <= _LONGEST_CLAIM), MOST_CLAIMS))


def _text(value: str | None, most: int = _LONGEST_TEXT) -> str:
    return (value or "")[:most]


def _disruption(status: Json) -> Disruption | None:
    for condition in status.get("conditions") or []:
        if condition.get("type") == "DisruptionTarget" and condition.get("status") == "True":
            return Disruption(
                _text(condition.get("reason")),
                _text(condition.get("message")),
                readings.moment(condition.get("lastTransitionTime")),
            )
    return None


def _node_silent(status: Json) -> bool:
    """Whether the node controller, and not the kubelet, has called the pod not ready.

    A kubelet derives Ready from ContainersReady; the controller changes only Ready, and does so
    for the pods of a node that does not report. No right to read nodes is needed to see it.
    """
    states = {c.get("type"): c.get("status") for c in status.get("conditions") or []}
    return states.get("Ready") == "False" and states.get("ContainersReady") == "True"


def _container(status: Json) -> ContainerView:
    state = status.get("state") or {}
    waiting, ended = state.get("waiting"), state.get("terminated")
    last = (status.get("lastState") or {}).get("terminated") or {}
    return ContainerView(
        name=status["name"],
        image=_text(status.get("image"), _LONGEST_IMAGE),
        running="running" in state,
        waiting_reason=_text((waiting or {}).get("reason")),
        exit_code=ended.get("exitCode") if ended else None,
        reason=_text((ended or last).get("reason")),
        message=_text((waiting or ended or {}).get("message")),
        ended_at=readings.moment((ended or last).get("finishedAt")),
    )
