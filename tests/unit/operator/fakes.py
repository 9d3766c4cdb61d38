"""Declared fakes: an API server in memory with faults on order, and drivers that answer.

The fake server knows just what the loop relies on: 404 and 409, resource versions that grow with
every write, merge patches of a status. tests/e2e runs the same loop against a real one.
"""

# ruff: noqa: ARG002 - the fakes have the real signatures and know one namespace

import copy
from dataclasses import dataclass, field

from bagpipe_operator.api.objects import Json
from bagpipe_operator.cluster.client import ApiError
from bagpipe_operator.jobs.driver.progress import Progress, parse

# Later than all that these tests do.
GONE_BY = "2999-01-01T00:00:00Z"


def not_found(what: str) -> ApiError:
    return ApiError(404, "NotFound", f'"{what}" not found')


@dataclass
class FakeApi:
    """Objects by resource and name, the calls that were made, and faults by call."""

    objects: dict[tuple[str, str], Json] = field(default_factory=dict)
    calls: list[str] = field(default_factory=list)
    faults: dict[str, list[BaseException]] = field(default_factory=dict)
    lost: set[str] = field(default_factory=set)  # calls that take effect, and whose answer is lost
    version: int = 100
    events_about: dict[str, list[Json]] = field(default_factory=dict)  # by UID
    shown: list[Json] = field(default_factory=list)  # manifests of dry runs
    graces: dict[str, int | None] = field(default_factory=dict)  # of deleted pods, in seconds
    terminating: bool = False  # pods that are deleted stay for their grace period

    def fail(self, call: str, *errors: BaseException) -> None:
        """The next calls of that name raise these, one each."""
        self.faults.setdefault(call, []).extend(errors)

    def put(self, resource: str, obj: Json) -> None:
        self.objects[resource, obj["metadata"]["name"]] = copy.deepcopy(obj)

    def named(self, resource: str) -> list[str]:
        return sorted(name for kind, name in self.objects if kind == resource)

    def event_reasons(self) -> list[str]:
        return [o["reason"] for (kind, _), o in self.objects.items() if kind == "events"]

    async def create(self, resource: str, manifest: Json) -> Json:
        self._called(f"create {resource}")
        key = (resource, manifest["metadata"]["name"])
        if key in self.objects:
            raise ApiError(409, "AlreadyExists", f"{key[1]} already exists")
        created = copy.deepcopy(manifest)
        created["metadata"]["uid"] = f"uid-of-{key[1]}"
        self.objects[key] = created
        self._answers(f"create {resource}")
        return copy.deepcopy(created)

    async def try_create(self, resource: str, manifest: Json) -> None:
        self._called(f"try {resource}")
        self.shown.append(copy.deepcopy(manifest))

    async def get(self, resource: str, namespace: str, name: str) -> Json:
        self._called(f"get {resource}")
        return self._found(resource, name)

    async def events_of(self, namespace: str, uid: str) -> list[Json]:
        self._called(f"events of {uid}")
        return copy.deepcopy(self.events_about.get(uid, []))

    async def delete_pod(
        self, namespace: str, name: str, uid: str, grace_seconds: int | None = None
    ) -> bool:
        self._called(f"delete {name}")
        self.graces[name] = grace_seconds
        pod = self.objects.get(("pods", name))
        if pod is None or pod["metadata"]["uid"] != uid:
            return False
        if self.terminating:
            pod["metadata"]["deletionTimestamp"] = GONE_BY
            return True
        del self.objects["pods", name]
        self._answers("delete pod")
        return True

    async def get_job(self, namespace: str, name: str) -> Json:
        self._called("get job")
        return self._found("jobs", name)

    async def get_schedule(self, namespace: str, name: str) -> Json:
        self._called("get schedule")
        return self._found("schedules", name)

    async def list_jobs(self, namespace: str, label: str, most: int | None = None) -> list[Json]:
        self._called("list jobs")
        key, _, value = label.partition("=")
        jobs = [job for (kind, _), job in self.objects.items() if kind == "jobs"]
        labels = [(job, job["metadata"].get("labels") or {}) for job in jobs]
        return [copy.deepcopy(job) for job, own in labels if own.get(key) == value][:most]

    async def delete_unchanged_job(self, namespace: str, name: str, uid: str, version: str) -> None:
        self._called("delete job")
        meta = self._found("jobs", name)["metadata"]
        if (meta["uid"], meta["resourceVersion"]) != (uid, version):
            raise ApiError(409, "Conflict", "the object has been modified")
        del self.objects["jobs", name]

    async def patch_status(
        self, namespace: str, name: str, patch: Json, urgent: bool = True
    ) -> Json:
        self._called("patch status")
        job = self._found("jobs", name)
        expected = patch["metadata"]["resourceVersion"]
        if expected != job["metadata"]["resourceVersion"]:
            raise ApiError(409, "Conflict", "the object has been modified")
        self.version += 1
        job["metadata"]["resourceVersion"] = str(self.version)
        merged = (job.get("status") or {}) | patch["status"]
        job["status"] = {key: value for key, value in merged.items() if value is not None}
        self.put("jobs", job)
        self._answers("patch status")
        return copy.deepcopy(job)

    def _answers(self, call: str) -> None:
        """Raises if the answer is to be lost, once."""
        if call in self.lost:
            self.lost.remove(call)
            raise ApiError(0, "Unreachable", f"the answer of {call} was lost")

    def _found(self, resource: str, name: str) -> Json:
        if (resource, name) not in self.objects:
            raise not_found(name)
        return copy.deepcopy(self.objects[resource, name])

    def _called(self, call: str) -> None:
        self.calls.append(call)
        if self.faults.get(call):
            raise self.faults[call].pop(0)


@dataclass
class FakeDrivers:
    """What the driver would say; None for a driver that does not answer."""

    says: str | None = None
    silent: float = 0.0
    forgotten: list[str] = field(default_factory=list)

    async def read(self, uid: str, ip: str, whose: tuple[str, int]) -> Progress | None:
        return parse(self.says) if self.says is not None else None

    async def works(self, ip: str) -> bool | None:
        progress = parse(self.says) if self.says is not None else None
        return None if progress is None else not progress.ended

    def silent_seconds(self, uid: str) -> float:
        return self.silent

    def forget(self, uid: str) -> None:
        self.forgotten.append(uid)
