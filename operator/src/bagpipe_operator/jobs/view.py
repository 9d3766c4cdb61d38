"""What the operator has seen of the cluster: jobs and their pods.

Fed by watches, so it may lag; whoever is about to end a job because something is *absent* here
asks the API server first. Not a cache of whole objects: a thousand pods are a few megabytes.
"""

from collections import deque
from collections.abc import Iterator
from dataclasses import dataclass, field, replace

from bagpipe_operator.api import names
from bagpipe_operator.api.objects import is_older
from bagpipe_operator.cluster.departed import Departed
from bagpipe_operator.cluster.kept_once import KeptOnce
from bagpipe_operator.jobs.claim import Claim, driver_name, taken
from bagpipe_operator.jobs.job_view import JobView
from bagpipe_operator.jobs.pod_view import PodView

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
        # Before they are sorted: who may make pods beside the job may make thousands with its UID.
        found = [key for key, pod in pods.items() if job is None or _is_of(job, pod)]
        own = [pods[key] for key in sorted(found)]
        if job_uid in self._guests:
            own = [pod for pod in own if self.user_of(job_uid, pod.attempt) == job_uid]
        return (*own, *self._taken_over(job))

    def _taken_over(self, job: JobView | None) -> list[PodView]:
        """The pods that a job has from another one."""
        claim = taken(job.status) if job is not None else None
        if job is None or claim is None or self.user_of(claim.uid, claim.attempt) != job.uid:
            return []
        pods = self._pods.within(job.namespace, claim.uid)
        lent = sorted(key for key, pod in pods.items() if _is_lent(claim, job.namespace, pod))
        return [_as_of(job, pods[key]) for key in lent]

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
