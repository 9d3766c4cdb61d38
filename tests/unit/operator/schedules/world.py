"""A schedule, its operator and a fake API server, with a clock that the test moves."""

# ruff: noqa: ARG002 - the fake has the real signatures and knows one namespace

import copy
from dataclasses import dataclass, field
from datetime import UTC, datetime, timedelta
from typing import Any

from prometheus_client import CollectorRegistry, generate_latest

from bagpipe_operator.api import names
from bagpipe_operator.api.objects import Json
from bagpipe_operator.cluster.client import ApiError
from bagpipe_operator.runtime.queue import WorkQueue
from bagpipe_operator.schedules.alarms import Alarms
from bagpipe_operator.schedules.metrics import ScheduleMetrics
from bagpipe_operator.schedules.reconcile import ScheduleReconciler
from bagpipe_operator.schedules.view import ScheduledJob, Schedules, ScheduleView

UID = "uid-of-nightly"
CREATED = datetime(2026, 11, 20, 4, 0, 30, tzinfo=UTC)


def minute(count: int) -> datetime:
    """The run `count` minutes after 04:00."""
    return datetime(2026, 11, 20, 4, 0, tzinfo=UTC) + timedelta(minutes=count)


def name_of(count: int) -> str:
    """The name of that run's job."""
    return f"nightly-{int(minute(count).timestamp()) // 60}"


def make_schedule(**spec: Any) -> Json:
    """A schedule of every minute, with fields of its spec changed."""
    return {
        "metadata": {
            "name": "nightly",
            "namespace": "lanes",
            "uid": UID,
            "generation": 1,
            "resourceVersion": "7",
            "creationTimestamp": CREATED.strftime("%Y-%m-%dT%H:%M:%SZ"),
        },
        "spec": {
            "schedule": "* * * * *",
            "timeZone": "Etc/UTC",
            "concurrencyPolicy": "Allow",
            "jobTemplate": {
                "metadata": {"labels": {"team": "lanes"}, "annotations": {"why": "regression"}},
                "spec": {"source": {"bags": ["pvc://recordings/drive.bag"]}},
            },
        }
        | spec,
    }


def make_job(name: str, end: str = "", uid: str = UID, at: str = "2026-11-20T04:30:00Z") -> Json:
    """A job of the schedule; `end` is Complete or Failed."""
    job: Json = {
        "metadata": {
            "name": name,
            "namespace": "lanes",
            "uid": f"uid-of-{name}",
            "labels": {names.LABEL_SCHEDULE: "nightly"},
            "ownerReferences": [names.owner_reference("nightly", uid, names.SCHEDULE_KIND)],
        },
        "status": {},
    }
    if end:
        job["status"] = {
            "completionTime": at,
            "conditions": [{"type": end, "status": "True"}],
        }
    return job


@dataclass
class FakeApi:
    """Says to be fake: schedules, jobs and Events by name, calls, and faults on order."""

    schedule: Json | None
    jobs: dict[str, Json] = field(default_factory=dict)
    written_events: list[Json] = field(default_factory=list)
    calls: list[str] = field(default_factory=list)
    faults: dict[str, list[ApiError]] = field(default_factory=dict)
    lost: dict[str, ApiError] = field(default_factory=dict)  # what comes in an answer's place
    version: int = 100
    pods: dict[str, Json] = field(default_factory=dict)

    def fail(self, call: str, *errors: ApiError) -> None:
        self.faults.setdefault(call, []).extend(errors)

    async def create(self, resource: str, manifest: Json) -> Json:
        self._called("event")
        if any(event["metadata"] == manifest["metadata"] for event in self.written_events):
            raise ApiError(409, "AlreadyExists", "it already exists")
        self.written_events.append(manifest)
        self._answers("event")
        return manifest

    async def get(self, resource: str, namespace: str, name: str) -> Json:
        self._called(f"get {resource}")
        if name not in self.pods:
            raise ApiError(404, "NotFound", f'"{name}" not found')
        return copy.deepcopy(self.pods[name])

    async def create_job(self, manifest: Json) -> Json:
        name = manifest["metadata"]["name"]
        self._called(f"create {name}")
        if name in self.jobs:
            raise ApiError(409, "AlreadyExists", f"{name} already exists")
        made = copy.deepcopy(manifest)
        made["metadata"]["uid"] = f"uid-of-{name}"
        self.jobs[name] = made
        self._answers("create")
        return copy.deepcopy(made)

    async def try_job(self, manifest: Json) -> None:
        name = manifest["metadata"]["name"]
        self._called(f"try {name}")
        if name in self.jobs:
            raise ApiError(409, "AlreadyExists", f"{name} already exists")

    async def list_jobs(self, namespace: str, label: str, most: int | None = None) -> list[Json]:
        self._called("list")
        key, _, value = label.partition("=")
        found = [j for j in self.jobs.values() if j["metadata"]["labels"].get(key) == value]
        return copy.deepcopy(found[:most])

    async def delete_job(self, namespace: str, name: str, uid: str) -> None:
        self._called(f"delete {name}")
        if name in self.jobs and self.jobs[name]["metadata"]["uid"] == uid:
            del self.jobs[name]

    async def get_schedule(self, namespace: str, name: str) -> Json:
        self._called("get")
        return copy.deepcopy(self._schedule())

    async def patch_schedule_status(self, namespace: str, name: str, patch: Json) -> Json:
        self._called("patch")
        schedule = self._schedule()
        if patch["metadata"]["resourceVersion"] != schedule["metadata"]["resourceVersion"]:
            raise ApiError(409, "Conflict", "the object has been modified")
        self.version += 1
        schedule["metadata"]["resourceVersion"] = str(self.version)
        merged = (schedule.get("status") or {}) | patch["status"]
        schedule["status"] = {k: v for k, v in merged.items() if v is not None}
        self._answers("patch")
        return copy.deepcopy(schedule)

    def _schedule(self) -> Json:
        if self.schedule is None:
            raise ApiError(404, "NotFound", '"nightly" not found')
        return self.schedule

    def _answers(self, call: str) -> None:
        if (error := self.lost.pop(call, None)) is not None:
            raise error

    def _called(self, call: str) -> None:
        self.calls.append(call)
        if self.faults.get(call):
            raise self.faults[call].pop(0)


class World:
    """One schedule and one operator over the fake."""

    def __init__(self, **spec: Any) -> None:
        self.api = FakeApi(make_schedule(**spec))
        self.clock = CREATED
        self.restart()

    def restart(self) -> None:
        """Another operator: nothing is remembered, and the watch has brought the schedule only."""
        self.view = Schedules()
        self.alarms = Alarms(WorkQueue(lambda: 0.0), self.now)
        self.registry = CollectorRegistry()
        self.metrics = ScheduleMetrics(self.view, self.registry)
        self.reconciler = ScheduleReconciler(
            self.api, self.view, self.alarms, self.metrics, self.now
        )
        self.deliver()

    def now(self) -> datetime:
        return self.clock

    def deliver(self) -> None:
        """The watch delivers the schedule and the jobs as they are."""
        assert self.api.schedule is not None
        self.view.put_schedule(ScheduleView.from_object(copy.deepcopy(self.api.schedule)))

    async def at(self, count: int, seconds: float = 0) -> None:
        """Reconciles at 04:00 and `count` minutes."""
        self.clock = minute(count) + timedelta(seconds=seconds)
        await self.reconciler.reconcile(UID)

    def change(self, **spec: Any) -> None:
        """The user edits the schedule, and the watch delivers it."""
        self.change_unseen(**spec)
        self.deliver()

    def change_unseen(self, **spec: Any) -> None:
        """The user edits the schedule, and the watch is late."""
        assert self.api.schedule is not None
        self.api.schedule["spec"] |= spec
        meta = self.api.schedule["metadata"]
        meta["generation"] += 1
        self.api.version += 1
        meta["resourceVersion"] = str(self.api.version)

    def end(self, name: str, how: str = "Complete", at: str = "2026-11-20T04:30:00Z") -> None:
        """A job ends, and the watch says so."""
        self.api.jobs[name]["status"] = make_job(name, how, at=at)["status"]
        self.view.put_job(ScheduledJob.from_object(self.api.jobs[name]))

    @property
    def names(self) -> list[str]:
        return sorted(self.api.jobs)

    @property
    def status(self) -> Json:
        assert self.api.schedule is not None
        return dict(self.api.schedule.get("status") or {})

    def condition(self, type_: str) -> tuple[str, str]:
        found = next(c for c in self.status["conditions"] if c["type"] == type_)
        return found["status"], found["reason"]

    def message(self, type_: str) -> str:
        return str(next(c["message"] for c in self.status["conditions"] if c["type"] == type_))

    def exposed(self) -> str:
        """What a scrape would get."""
        return generate_latest(self.registry).decode()

    def events(self) -> list[str]:
        """The Events so far, as `Type/Reason`."""
        return [f"{event['type']}/{event['reason']}" for event in self.api.written_events]
