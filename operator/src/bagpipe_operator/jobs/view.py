"""What the operator has seen of the cluster: jobs and their pods, trimmed to what it decides on.

Fed by watches, so it may lag; whoever is about to end a job because something is *absent* here
asks the API server first. Not a cache of whole objects: a thousand pods are a few megabytes.
"""

from collections import deque
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from datetime import datetime
from functools import cached_property

from bagpipe.marks import marks_of
from bagpipe_operator.api import names, readings
from bagpipe_operator.api.kept_spec import packed, scalars, what_decides
from bagpipe_operator.api.nesting import bounded
from bagpipe_operator.api.objects import Json, is_older
from bagpipe_operator.api.runs import schedule_of
from bagpipe_operator.cluster.departed import Departed
from bagpipe_operator.cluster.kept_once import KeptOnce
from bagpipe_operator.cluster.large_objects import TRIMMED, is_large
from bagpipe_operator.jobs.claim import Claim, driver_name, taken


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
            *(status.get("initContainerStatuses") or []),
            *(status.get("containerStatuses") or []),
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
            reason=status.get("reason") or "",
            message=status.get("message") or "",
            unschedulable=_unschedulable(status),
            containers=tuple(_container(s) for s in statuses),
            resource_version=str(meta.get("resourceVersion") or ""),
            node=(pod.get("spec") or {}).get("nodeName") or "",
            claims=_claims(pod.get("spec") or {}),
            disruption=_disruption(status),
            node_silent=_node_silent(status),
            shape=(meta.get("annotations") or {}).get(names.ANNOTATION_SHAPE, ""),
        )


def _unschedulable(status: Json) -> str:
    for condition in status.get("conditions") or []:
        if condition.get("type") == "PodScheduled" and condition.get("status") == "False":
            if condition.get("reason") == "SchedulingGated":
                return ""  # a queue holds it back, and nobody has looked for a node
            return condition.get("message") or condition.get("reason") or "no node fits"
    return ""


def _claims(spec: Json) -> tuple[str, ...]:
    sources = [v.get("persistentVolumeClaim") for v in spec.get("volumes") or []]
    return tuple(source["claimName"] for source in sources if source)


def _disruption(status: Json) -> Disruption | None:
    for condition in status.get("conditions") or []:
        if condition.get("type") == "DisruptionTarget" and condition.get("status") == "True":
            return Disruption(
                condition.get("reason") or "",
                condition.get("message") or "",
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
        image=status.get("image") or "",
        running="running" in state,
        waiting_reason=(waiting or {}).get("reason") or "",
        exit_code=ended.get("exitCode") if ended else None,
        reason=(ended or last).get("reason") or "",
        message=(waiting or ended or {}).get("message") or "",
        ended_at=readings.moment((ended or last).get("finishedAt")),
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
    created: str = ""  # as the API server writes it
    schedule: tuple[str, str] = ("", "")  # the name and the UID of the one that made it
    # `labels` and `annotations`, as far as results keep them
    marks: Json = field(default_factory=dict)
    # `spec` and `marks` whole, where these are only what decides; empty if it is too large to keep
    packed: bytes | None = None
    # Each call about it is a megabyte's work for the API server and for us.
    large: bool = False

    @cached_property
    def finished(self) -> bool:
        """Whether the job has ended, well or not, and this has been written."""
        return self._is({"Complete", "Failed"})

    @property
    def managed_elsewhere(self) -> bool:
        """Whether somebody else runs it, as spec.managedBy says."""
        return bool(self.spec.get("managedBy", names.MANAGER) != names.MANAGER)

    @property
    def suspended(self) -> bool:
        """Whether it has been written that the job rests, without pods."""
        return self._is({"Suspended"})

    def _is(self, types: set[str]) -> bool:
        return any(
            c.get("type") in types and c.get("status") == "True"
            for c in self.status.get("conditions") or []
        )

    def kept(self) -> "JobView":
        """The job with as much of its spec as is kept until the next visit."""
        if self.finished:
            marks = _few(self.marks) if self.status.get("notifications") else {}
            return replace(self, spec=scalars(self.spec, _OF_ENDED), marks=marks, packed=b"")
        decides = what_decides(self.spec, _OF_UNFINISHED)
        entire = self.packed
        if entire is None:
            entire = packed({"spec": self.spec, "marks": self.marks})
        return replace(self, spec=decides, marks={}, packed=entire)

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
            spec=bounded(readings.mapping(job.get("spec"))),
            status=bounded(readings.status(job.get("status"))),
            created=str(meta.get("creationTimestamp") or ""),
            schedule=schedule_of(job),
            marks=marks_of(meta.get("labels") or {}, meta.get("annotations") or {}),
            packed=b"" if TRIMMED in job else None,
            large=is_large(job),
        )


# How much of an ended job's marks is kept for those who are notified of its end.
_MOST_MARKS, _LONGEST_MARK = 16, 253


def _few(marks: Json) -> Json:
    return {
        kind: {k: v[:_LONGEST_MARK] for k, v in list(found.items())[:_MOST_MARKS] if len(k) <= 317}
        for kind, found in marks.items()
    }


# What an ended job's spec still decides: whether it is removed some time.
_OF_ENDED = frozenset({"ttlAfterFinished"})
# And of any other: whether it may run, how long, how often, and whose it is.
_OF_UNFINISHED = _OF_ENDED | {
    "suspend", "startDeadline", "activeDeadline", "backoffLimit", "managedBy", "resumeFrom",
    "queueName",
}  # fmt: skip
# Spark deletes an executor as soon as it has ended; the last ones show why.
MOST_GONE_PODS = 10


@dataclass
class _Gone:
    """The last pods that a job has lost. Its drivers are kept apart: an account that is left in one
    decides, and the garbage collector deletes a driver's executors, which are many, behind it."""

    drivers: dict[int, PodView] = field(default_factory=dict)  # by attempt
    others: deque[PodView] = field(default_factory=lambda: deque(maxlen=MOST_GONE_PODS))

    def add(self, pod: PodView, is_driver: bool) -> None:
        if not is_driver:
            self.others.append(pod)
            return
        self.drivers.pop(pod.attempt, None)
        self.drivers[pod.attempt] = pod
        if len(self.drivers) > MOST_GONE_PODS:
            del self.drivers[next(iter(self.drivers))]


class View:
    """All jobs by UID, the pods of each by name, and the last pods that each has lost."""

    def __init__(self) -> None:
        self._jobs: dict[str, JobView] = {}
        # By the job that each was made for, as its label was when it was last seen.
        self._pods = KeptOnce[PodView](lambda pod: pod.job_uid)
        self._gone: dict[str, _Gone] = {}
        # The jobs that run, or have run, in the pods that were made for another job, by its UID.
        self._guests: dict[str, set[str]] = {}
        # Of those the one that counts, with its claim's attempt, as far as it has been looked for.
        self._last_guests: dict[str, tuple[str, int] | None] = {}
        self._pooled: dict[str, set[str]] = {}  # by namespace
        self._departed = Departed()

    def job(self, uid: str) -> JobView | None:
        """The job, or None when it is gone or was never seen."""
        return self._jobs.get(uid)

    def namespace_of(self, uid: str) -> str:
        """A job's namespace; empty for a job that is not known."""
        job = self._jobs.get(uid)
        return job.namespace if job else ""

    def called(self, uid: str) -> tuple[str, str]:
        """A job's namespace and name; empty for a job that is not known."""
        job = self._jobs.get(uid)
        return (job.namespace, job.name) if job else ("", "")

    def jobs(self) -> Iterator[JobView]:
        """All known jobs, those that have ended too."""
        return iter(list(self._jobs.values()))

    def pods(self, job_uid: str) -> tuple[PodView, ...]:
        """A job's pods, by name.

        Labels are anybody's to write: a pod of another namespace is nobody's, whatever it says.
        And a driver's token may write any UID, but no other job's name.
        Pods that run another job are that one's, and look as if they had been made for it.
        """
        job = self._jobs.get(job_uid)
        pods = self._pods.within(job.namespace, job_uid) if job else self._pods.of(job_uid)
        found = [pods[key] for key in sorted(pods)]
        own = [pod for pod in found if job is None or _is_of(job, pod)]
        if job_uid in self._guests:
            own = [pod for pod in own if self.user_of(job_uid, pod.attempt) == job_uid]
        return (*own, *self._taken_over(job))

    def _taken_over(self, job: JobView | None) -> list[PodView]:
        """The pods that a job has from another one."""
        claim = taken(job.status) if job is not None else None
        if job is None or claim is None or self.user_of(claim.uid, claim.attempt) != job.uid:
            return []
        pods = self._pods.within(job.namespace, claim.uid)
        return [
            _as_of(job, pods[key])
            for key in sorted(pods)
            if _is_lent(claim, job.namespace, pods[key])
        ]

    def user_of(self, job_uid: str, attempt: int) -> str:
        """Whose the pods are that were made for a job's attempt: its own, or of the last guest."""
        guest = self._last_guest(job_uid)
        return guest[0] if guest is not None and guest[1] == attempt else job_uid

    def job_to_visit(self, pod: PodView) -> str | None:
        """The job that a pod's news are of; None for a pod of another namespace than the job that
        it names, which may come as often as somebody there likes."""
        for uid in (self.user_of(pod.job_uid, pod.attempt), pod.job_uid):
            job = self._jobs.get(uid)
            if job is None or job.namespace == pod.namespace:
                return uid
        return None

    def _last_guest(self, job_uid: str) -> tuple[str, int] | None:
        """The guest that has, or had last, a job's pods, and of which attempt they are.

        Looked for once after each change, and not for each pod and each other guest: a pool that
        is used all day has a thousand.
        """
        if job_uid not in self._guests:
            return None
        if job_uid not in self._last_guests:
            guest = max((self._jobs[uid] for uid in self._guests[job_uid]), key=_order_of_guests)
            claim = taken(guest.status)
            self._last_guests[job_uid] = (guest.uid, claim.attempt) if claim is not None else None
        return self._last_guests[job_uid]

    def pooled(self, namespace: str) -> list[JobView]:
        """The jobs of a namespace whose status names a pool, but for those that have ended and have
        no pods."""
        jobs = (self._jobs[uid] for uid in sorted(self._pooled.get(namespace, ())))
        return [job for job in jobs if not job.finished or self._has_pods(job)]

    def namespaces_of_pools(self) -> list[str]:
        """The namespaces that have such jobs."""
        return sorted(self._pooled)

    def _has_pods(self, job: JobView) -> bool:
        """Whether there may be any, its own or another's: thousands have none."""
        made_for = str(job.status["pool"].get("uid") or job.uid)
        return any(self._pods.within(job.namespace, uid) for uid in (job.uid, made_for))

    def shown(self, pod: PodView) -> PodView:
        """A pod as it came from the API server, as that of the job that it runs."""
        user = self._jobs.get(self.user_of(pod.job_uid, pod.attempt))
        claim = taken(user.status) if user is not None else None
        if user is None or claim is None or user.uid == pod.job_uid:
            return pod
        return _as_of(user, pod) if _is_lent(claim, user.namespace, pod) else pod

    def all_pods(self) -> Iterator[PodView]:
        """The pods of all jobs."""
        return iter(self._pods)

    def pods_of(self, job_uid: str, attempt: int) -> tuple[PodView, ...]:
        """The pods of one attempt, without a copy that somebody has made of its driver.

        A copy has another name, and its end and its troubles are not the job's.
        """
        job = self._jobs.get(job_uid)
        own = driver_name(job.name, attempt, job.status) if job is not None else None
        return tuple(
            pod
            for pod in self.pods(job_uid)
            if pod.attempt == attempt
            and (pod.role != names.ROLE_DRIVER or own is None or pod.name == own)
        )

    def driver(self, job_uid: str, attempt: int) -> PodView | None:
        """The driver of one attempt."""
        found = (p for p in self.pods_of(job_uid, attempt) if p.role == names.ROLE_DRIVER)
        return next(found, None)

    def put_job(self, job: JobView) -> bool:
        """Keeps a job unless it is gone or something newer is known; says whether it was kept.

        The answer to our own PATCH usually arrives before the watch has caught up with it.
        """
        known = self._jobs.get(job.uid)
        if job.uid in self._departed:
            return False
        if known and is_older(job.resource_version, known.resource_version):
            return False
        if job.finished:
            self._gone.pop(job.uid, None)
        self._leave_pool(job.uid)
        self._jobs[job.uid] = job.kept()
        self._enter_pool(job)
        return True

    def _enter_pool(self, job: JobView) -> None:
        if job.status.get("pool"):
            self._pooled.setdefault(job.namespace, set()).add(job.uid)
        if (claim := taken(job.status)) is not None:
            self._guests.setdefault(claim.uid, set()).add(job.uid)
            self._last_guests.pop(claim.uid, None)

    def _leave_pool(self, uid: str) -> None:
        known = self._jobs.get(uid)
        if known is None:
            return
        pooled = self._pooled.get(known.namespace, set())
        pooled.discard(uid)
        if not pooled:
            self._pooled.pop(known.namespace, None)
        claim = taken(known.status)
        if claim is not None:
            guests = self._guests[claim.uid]
            guests.discard(uid)
            self._last_guests.pop(claim.uid, None)
            if not guests:
                del self._guests[claim.uid]

    def drop_job(self, uid: str) -> None:
        """Forgets a job for good; its pods are forgotten when their own deletion arrives."""
        self._leave_pool(uid)
        if self._jobs.pop(uid, None) is not None:  # else its UID is a label that anybody may write
            self._departed.add(uid)
        self._gone.pop(uid, None)

    def uids(self) -> list[str]:
        """Of all known jobs, and of those that have pods and are not known, but for pods that run,
        or have run, another job: they may outlast the one that they were made for."""
        owners = (uid for uid in self._pods.owners() if uid not in self._guests)
        return list(dict.fromkeys((*self._jobs, *owners)))

    def namespaces_of(self, uid: str) -> set[str]:
        """Where a job is; of one that is not known the pods that were made for it, as their labels
        say."""
        job = self._jobs.get(uid)
        if job is not None:
            return {job.namespace}
        return self._pods.namespaces(uid)

    def forget(self, job_uid: str) -> None:
        """Forgets a job that is gone, and its pods; those that still exist are reported again."""
        self.drop_job(job_uid)
        self._pods.take_out_all(job_uid)

    def gone_pods(self, job_uid: str) -> tuple[PodView, ...]:
        """The last pods of an unfinished job that were seen to go, as they were at the end."""
        gone = self._gone.get(job_uid, _Gone())
        return (*gone.drivers.values(), *gone.others)

    def put_pod(self, pod: PodView) -> bool:
        """Keeps a pod unless something newer of that name is known; returns whether it is news.

        The answer to our own POST or GET may be ahead of the watch, which then still delivers the
        end of a namesake: taken for this pod's, it would end a healthy driver.
        """
        known = self._pods.known(pod)
        if known is not None and is_older(pod.resource_version, known.resource_version):
            return False
        self._pods.put(pod)
        return known is None or replace(known, resource_version=pod.resource_version) != pod

    def drop_pod(self, pod: PodView) -> None:
        """Takes a pod away, unless another of the same name has taken its place."""
        known = self._pods.known(pod)
        if known is None or known.uid != pod.uid:
            return
        self._pods.take_out(known)
        shown = self.shown(known)
        job = self._jobs.get(shown.job_uid)
        if job is not None and not job.finished and _is_of(job, shown):
            went = replace(pod, job_uid=job.uid, job=job.name, attempt=shown.attempt)
            # A copy that somebody has made of a driver has another name.
            own = driver_name(job.name, shown.attempt, job.status)
            is_driver = (pod.role, pod.name) == (names.ROLE_DRIVER, own)
            self._gone.setdefault(job.uid, _Gone()).add(went, is_driver)


def _order_of_guests(job: JobView) -> tuple[bool, str, str]:
    """One that has not ended comes after those that have, of which the last one counts."""
    return not job.finished, job.status.get("completionTime") or "", job.uid


def _is_of(job: JobView, pod: PodView) -> bool:
    return (pod.namespace, pod.job) == (job.namespace, job.name)


def _is_lent(claim: Claim, namespace: str, pod: PodView) -> bool:
    """Whether a pod is one of those that a claim is for."""
    made_for = (pod.namespace, pod.job_uid, pod.job, pod.attempt)
    is_another = pod.role == names.ROLE_DRIVER and pod.uid != claim.driver
    return made_for == (namespace, claim.uid, claim.job, claim.attempt) and not is_another


def _as_of(job: JobView, pod: PodView) -> PodView:
    """A pod that a job has taken over, as if it had been made for the job's first attempt."""
    return replace(pod, job_uid=job.uid, job=job.name, attempt=1)
