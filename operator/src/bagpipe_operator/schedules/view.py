"""What the operator has seen of schedules and of the jobs that they made, trimmed to what counts.

Fed by watches, so it may lag; before a job is started the API server itself is asked.
"""

from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from datetime import datetime

from bagpipe_operator.api import readings
from bagpipe_operator.api.kept_spec import scalars
from bagpipe_operator.api.nesting import DEEPEST, bounded
from bagpipe_operator.api.objects import Json, is_older
from bagpipe_operator.api.pool_driver import own_driver_in_pool
from bagpipe_operator.api.runs import PassedRun, controller_of, passed_run, run_of
from bagpipe_operator.cluster.departed import Departed
from bagpipe_operator.cluster.kept_once import KeptOnce
from bagpipe_operator.cluster.large_objects import is_large


@dataclass(frozen=True)
class ScheduleView:
    """A SimulationSchedule."""

    namespace: str
    name: str
    uid: str
    generation: int
    resource_version: str
    created: datetime
    deleting: bool = False
    spec: Json = field(default_factory=dict)
    status: Json = field(default_factory=dict)
    # Its jobs' template is a megabyte's work for the API server and for us.
    large: bool = False

    @property
    def suspended(self) -> bool:
        """Whether its runs are let pass."""
        return bool(self.spec.get("suspend"))

    def kept(self) -> "ScheduleView":
        """Without the jobs' template, since a run that is due is started from a new reading."""
        return replace(self, spec=scalars(self.spec))

    @classmethod
    def from_object(cls, schedule: Json) -> "ScheduleView":
        """A schedule as the API server sends it."""
        meta = schedule["metadata"]
        return cls(
            namespace=meta["namespace"],
            name=meta["name"],
            uid=meta["uid"],
            generation=int(meta.get("generation") or 1),
            resource_version=str(meta.get("resourceVersion") or ""),
            created=datetime.fromisoformat(meta["creationTimestamp"]),
            deleting=bool(meta.get("deletionTimestamp")),
            # Its jobs' spec begins two levels further in, and must be as deep as it was written.
            spec=bounded(readings.mapping(schedule.get("spec")), DEEPEST + 2),
            status=bounded(readings.status(schedule.get("status"))),
            large=is_large(schedule),
        )


@dataclass(frozen=True)
class Result:
    """What a job that has ended came to."""

    verdict: str  # Passed, Failed, Invalid, or Errored where it could not be run
    seconds: float  # from its start to its end
    cases: tuple[tuple[str, int], ...]  # by state, in the order of CASE_STATES


# Of the last job of a schedule; flaky ones are those of its comparison.
CASE_STATES = ("passed", "failed", "invalid", "errored", "regressed", "flaky", "quarantined")


@dataclass(frozen=True)
class ScheduledJob:
    """A SimulationJob that a schedule made."""

    namespace: str
    name: str
    uid: str
    schedule_uid: str
    run: datetime | None  # the moment that it was made for, in UTC
    deleting: bool = False
    complete: bool = False
    failed: bool = False
    completed: datetime | None = None
    passed_run: PassedRun | None = None
    result: Result | None = None  # of one that has ended
    owes: bool = False  # somebody is still to be notified of its end, as its status says
    pool_driver: str = ""  # the pod of its last driver, where that may run another job
    resource_version: str = field(default="", compare=False)

    @property
    def finished(self) -> bool:
        """Whether it has ended, well or not."""
        return self.complete or self.failed

    @property
    def passed(self) -> bool:
        """Whether it has ended with the verdict Passed."""
        return self.result is not None and self.result.verdict == "Passed"

    @classmethod
    def from_object(cls, job: Json) -> "ScheduledJob":
        """A job as the API server sends it."""
        meta, status = job["metadata"], readings.status(job.get("status"))
        true = {c.get("type") for c in status.get("conditions") or [] if c.get("status") == "True"}
        return cls(
            namespace=meta["namespace"],
            name=meta["name"],
            uid=meta["uid"],
            schedule_uid=controller_of(job),
            run=run_of(meta["name"]),
            deleting=bool(meta.get("deletionTimestamp")),
            complete="Complete" in true,
            failed="Failed" in true,
            completed=readings.moment(status.get("completionTime")),
            passed_run=passed_run(meta["name"], status),
            # Of one that runs it would change all the time, and nobody goes by it.
            result=_result(status, "Complete" in true) if true & {"Complete", "Failed"} else None,
            pool_driver=own_driver_in_pool(meta["name"], status),
            owes=any(each["state"] == "Pending" for each in status.get("notifications") or []),
            resource_version=str(meta.get("resourceVersion") or ""),
        )


def _result(status: Json, complete: bool) -> Result:
    verdict = str(status.get("verdict") or "")
    if not complete:
        verdict = "Errored"
    elif verdict not in {"Passed", "Failed"}:
        verdict = "Invalid"
    begun = readings.moment(status.get("startTime"))
    ended = readings.moment(status.get("completionTime"))
    seconds = (ended - begun).total_seconds() if begun and ended else 0.0
    counts = status.get("cases") or {}
    comparisons = status.get("comparisons") or []
    flaky = sum(readings.whole(each.get("flaky")) or 0 for each in comparisons)
    cases = counts | {"flaky": flaky}
    return Result(
        verdict, max(0.0, seconds), tuple((state, cases.get(state, 0)) for state in CASE_STATES)
    )


def job_name(schedule: str, run: datetime) -> str:
    """The name of the job of one run: the same whoever makes it, so nobody makes it twice."""
    return f"{schedule}-{int(run.timestamp()) // 60}"


class Schedules:
    """All schedules by UID, and by namespace and name the jobs that call one their owner.

    Owners are anybody's to write: a job of another namespace is nobody's, whatever it says.
    """

    def __init__(self) -> None:
        self._schedules: dict[str, ScheduleView] = {}
        # By the owner that each called its own when it was last seen.
        self._jobs = KeptOnce[ScheduledJob](lambda job: job.schedule_uid)
        # A job that passed may be gone before its schedule is looked at, as by ttlAfterFinished.
        self._passed: dict[str, dict[str, PassedRun]] = {}
        self._departed = Departed()

    def schedule(self, uid: str) -> ScheduleView | None:
        """The schedule, or None when it is gone or was never seen."""
        return self._schedules.get(uid)

    def called(self, uid: str) -> tuple[str, str]:
        """A schedule's namespace and name; empty for one that is not known."""
        schedule = self._schedules.get(uid)
        return (schedule.namespace, schedule.name) if schedule else ("", "")

    def namespace_of(self, uid: str) -> str:
        """A schedule's namespace; empty for one that is not known."""
        schedule = self._schedules.get(uid)
        return schedule.namespace if schedule else ""

    def schedules(self) -> Iterator[ScheduleView]:
        """All known schedules."""
        return iter(list(self._schedules.values()))

    def uids(self) -> list[str]:
        """Of all known schedules, and of others of which a job or a run that passed is known."""
        return list(dict.fromkeys((*self._schedules, *self._jobs.owners(), *self._passed)))

    def namespaces_of(self, uid: str) -> set[str]:
        """Where a schedule is; of one that is not known the jobs that call it their owner."""
        schedule = self._schedules.get(uid)
        if schedule is not None:
            return {schedule.namespace}
        return {job.namespace for job in self._jobs.of(uid).values()}

    def put_schedule(self, schedule: ScheduleView) -> bool:
        """Keeps a schedule unless it is gone or something newer is known; says whether it was."""
        known = self._schedules.get(schedule.uid)
        if schedule.uid in self._departed:
            return False
        if known and is_older(schedule.resource_version, known.resource_version):
            return False
        self._schedules[schedule.uid] = schedule.kept()
        return True

    def drop_schedule(self, uid: str) -> None:
        """Forgets a schedule for good; its jobs are forgotten when their own deletion arrives."""
        if self._schedules.pop(uid, None) is not None:  # else its UID is what anybody may write
            self._departed.add(uid)

    def forget(self, uid: str) -> None:
        """Forgets a schedule that is gone, and its jobs, which go with it."""
        self.drop_schedule(uid)
        self._jobs.take_out_all(uid)
        self._passed.pop(uid, None)

    def last_passed(self, uid: str) -> PassedRun | None:
        """The latest of a schedule's runs that was seen to have passed."""
        return self._passed.get(uid, {}).get(self.namespace_of(uid))

    def jobs(self, uid: str) -> tuple[ScheduledJob, ...]:
        """A schedule's jobs, the earliest run first."""
        schedule, jobs = self._schedules.get(uid), self._jobs.of(uid).values()
        own = (job for job in jobs if schedule is None or schedule.namespace == job.namespace)
        return tuple(sorted(own, key=lambda job: (len(job.name), job.name)))

    def put_job(self, job: ScheduledJob) -> bool:
        """Keeps a job; says whether anything that a schedule goes by has changed.

        A list or the answer to our own POST may be ahead of the watch, which then still delivers
        what was before.
        """
        known = self._jobs.known(job)
        if job.uid in self._departed:
            return False
        if known is not None and is_older(job.resource_version, known.resource_version):
            return False
        self._jobs.put(job)
        if known is not None:
            self._forget_passed_without_jobs(known.schedule_uid)
        if job.passed_run is not None:
            passed = self._passed.setdefault(job.schedule_uid, {})
            before = passed.get(job.namespace, job.passed_run)
            passed[job.namespace] = max(before, job.passed_run)
        return known != job

    def replace_jobs(self, uid: str, jobs: list[ScheduledJob]) -> None:
        """Takes the API server's own list in place of what was seen.

        The watch may have brought what is newer while the list was read.
        """
        listed = [job for job in jobs if job.schedule_uid == uid]
        known = [each for job in listed if (each := self._jobs.known(job)) is not None]
        newest = [each for each in known if each.schedule_uid == uid]
        self._jobs.take_out_all(uid)
        for job in (*newest, *listed):
            self.put_job(job)

    def drop_job(self, job: ScheduledJob) -> None:
        """Forgets a job, unless another of the same name has taken its place."""
        known = self._jobs.known(job)
        if known is not None and known.uid == job.uid:
            self._jobs.take_out(known)
            self._forget_passed_without_jobs(known.schedule_uid)

    def remove_job(self, job: ScheduledJob) -> None:
        """Forgets a job for good."""
        self.drop_job(job)
        self._departed.add(job.uid)

    def _forget_passed_without_jobs(self, uid: str) -> None:
        """Owners can be written again, without end."""
        if uid not in self._schedules and not self._jobs.of(uid):
            self._passed.pop(uid, None)
