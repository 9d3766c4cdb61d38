"""What the operator has seen of the cluster: jobs and their pods, trimmed to what it decides on.

Fed by watches, so it may lag; whoever is about to end a job because something is *absent* here
asks the API server first. Not a cache of whole objects: a thousand pods are a few megabytes.
"""

from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Any

from bagpipe_operator import names

Json = dict[str, Any]


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


@dataclass(frozen=True)
class PodView:
    """A pod of a job."""

    namespace: str
    name: str
    uid: str
    job_uid: str
    role: str
    attempt: int
    phase: str = "Pending"
    ip: str = ""
    deleting: bool = False
    reason: str = ""
    message: str = ""
    unschedulable: str = ""  # the scheduler's message, as long as there is no node
    containers: tuple[ContainerView, ...] = ()

    @property
    def ended(self) -> bool:
        """Whether all its containers are over for good."""
        return self.phase in {"Succeeded", "Failed"}

    def container(self, name: str) -> ContainerView | None:
        """The container of that name, init containers included; None before the kubelet told."""
        return next((c for c in self.containers if c.name == name), None)

    @classmethod
    def from_object(cls, pod: Json) -> "PodView":
        """Trims a pod as the API server sends it."""
        meta, status = pod["metadata"], pod.get("status") or {}
        labels = meta.get("labels") or {}
        attempt = labels.get(names.LABEL_ATTEMPT, "")
        statuses = [
            *(status.get("initContainerStatuses") or []),
            *(status.get("containerStatuses") or []),
        ]
        return cls(
            namespace=meta["namespace"],
            name=meta["name"],
            uid=meta["uid"],
            job_uid=labels.get(names.LABEL_JOB_UID, ""),
            role=labels.get(names.LABEL_ROLE, ""),
            attempt=int(attempt) if attempt.isdecimal() else 0,
            phase=status.get("phase") or "Pending",
            ip=status.get("podIP") or "",
            deleting=bool(meta.get("deletionTimestamp")),
            reason=status.get("reason") or "",
            message=status.get("message") or "",
            unschedulable=_unschedulable(status),
            containers=tuple(_container(s) for s in statuses),
        )


def _unschedulable(status: Json) -> str:
    for condition in status.get("conditions") or []:
        if condition.get("type") == "PodScheduled" and condition.get("status") == "False":
            return condition.get("message") or condition.get("reason") or "no node fits"
    return ""


def _container(status: Json) -> ContainerView:
    state = status.get("state") or {}
    waiting, ended = state.get("waiting"), state.get("terminated")
    last = (status.get("lastState") or {}).get("terminated") or {}
    return ContainerView(
        name=status["name"],
        image=status.get("image") or "",
        running="running" in state,
        waiting_reason=(waiting or {}).get("reason") or "",
        exit_code=ended.get("exitCode") if ended else None,
        reason=(ended or last).get("reason") or "",
        message=(waiting or ended or {}).get("message") or "",
    )


@dataclass(frozen=True)
class JobView:
    """A SimulationJob."""

    namespace: str
    name: str
    uid: str
    generation: int
    resource_version: str
    deleting: bool = False
    spec: Json = field(default_factory=dict)
    status: Json = field(default_factory=dict)

    @property
    def finished(self) -> bool:
        """Whether the job has ended, well or not, and this has been written."""
        return any(
            c.get("type") in {"Complete", "Failed"} and c.get("status") == "True"
            for c in self.status.get("conditions") or []
        )

    @classmethod
    def from_object(cls, job: Json) -> "JobView":
        """A job as the API server sends it."""
        meta = job["metadata"]
        return cls(
            namespace=meta["namespace"],
            name=meta["name"],
            uid=meta["uid"],
            generation=int(meta.get("generation") or 1),
            resource_version=str(meta.get("resourceVersion") or ""),
            deleting=bool(meta.get("deletionTimestamp")),
            spec=job.get("spec") or {},
            status=job.get("status") or {},
        )


class View:
    """All jobs by UID, and the pods of each by name."""

    def __init__(self) -> None:
        self._jobs: dict[str, JobView] = {}
        self._pods: dict[str, dict[str, PodView]] = {}

    def job(self, uid: str) -> JobView | None:
        """The job, or None when it is gone or was never seen."""
        return self._jobs.get(uid)

    def jobs(self) -> Iterator[JobView]:
        """All known jobs, those that have ended too."""
        return iter(list(self._jobs.values()))

    def pods(self, job_uid: str) -> tuple[PodView, ...]:
        """A job's pods, by name."""
        pods = self._pods.get(job_uid, {})
        return tuple(pods[name] for name in sorted(pods))

    def driver(self, job_uid: str, attempt: int) -> PodView | None:
        """The driver of one attempt."""
        for pod in self._pods.get(job_uid, {}).values():
            if pod.role == names.ROLE_DRIVER and pod.attempt == attempt:
                return pod
        return None

    def put_job(self, job: JobView) -> bool:
        """Keeps a job unless something newer is known; says whether it was kept.

        The answer to our own PATCH usually arrives before the watch has caught up with it.
        """
        known = self._jobs.get(job.uid)
        if known and _is_older(job.resource_version, known.resource_version):
            return False
        self._jobs[job.uid] = job
        return True

    def drop_job(self, uid: str) -> None:
        """Forgets a job; its pods are forgotten when their own deletion arrives."""
        self._jobs.pop(uid, None)

    def put_pod(self, pod: PodView) -> None:
        """Keeps a pod."""
        self._pods.setdefault(pod.job_uid, {})[pod.name] = pod

    def drop_pod(self, pod: PodView) -> None:
        """Forgets a pod, unless another of the same name has taken its place."""
        pods = self._pods.get(pod.job_uid, {})
        known = pods.get(pod.name)
        if known and known.uid == pod.uid:
            del pods[pod.name]
        if not pods:
            self._pods.pop(pod.job_uid, None)


def _is_older(version: str, known: str) -> bool:
    """Resource versions of one kind are comparable numbers in Kubernetes 1.34's storage."""
    if version.isdecimal() and known.isdecimal():
        return int(version) < int(known)
    return False
