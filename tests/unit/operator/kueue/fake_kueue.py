"""A declared fake of Kueue: it admits, evicts and refuses when the test says so.

It writes the conditions as a real one (kueue.x-k8s.io/v1beta2) was seen to write them.
"""

# ruff: noqa: ARG002 - the fake has the real signatures and knows one namespace

import copy
from dataclasses import dataclass
from typing import Any

from bagpipe_operator.api.objects import Json
from bagpipe_operator.cluster.client import ApiError
from bagpipe_operator.jobs.kueue.queueing import Queueing
from bagpipe_operator.jobs.kueue.workload_view import Workloads, WorkloadView
from bagpipe_operator.jobs.reconcile import Reconciler
from bagpipe_operator.jobs.view import View
from bagpipe_operator.settings import Settings
from tests.unit.operator.builders import JobBuilder, make_job
from tests.unit.operator.fakes import FakeApi
from tests.unit.operator.world import World

SINCE = "2026-11-20T04:00:00Z"


@dataclass
class FakeKueueApi(FakeApi):
    """Workloads, flavors and priority classes beside the other objects."""

    async def create_workload(self, manifest: Json) -> Json:
        made = await self.create("workloads", manifest)
        return self._kept(made)

    async def get_workload(self, namespace: str, name: str) -> Json:
        return await self.get("workloads", namespace, name)

    async def patch_workload_status(self, namespace: str, name: str, patch: Json) -> Json:
        self._called("patch workload")
        found = self._found("workloads", name)
        if patch["metadata"]["resourceVersion"] != found["metadata"]["resourceVersion"]:
            raise ApiError(409, "Conflict", "the object has been modified")
        status = (found.get("status") or {}) | patch["status"]
        found["status"] = {key: value for key, value in status.items() if value is not None}
        kept = self._kept(found)
        self._answers("patch workload")
        return kept

    async def delete_workload(self, namespace: str, name: str, uid: str) -> None:
        self._called("delete workload")
        if self._found("workloads", name)["metadata"]["uid"] == uid:
            del self.objects["workloads", name]

    async def get_resource_flavor(self, name: str) -> Json:
        return await self.get("flavors", "", name)

    async def get_priority_class(self, group: str, name: str) -> Json:
        return await self.get(f"priorities of {group}", "", name)

    def _kept(self, workload: Json) -> Json:
        self.version += 1
        workload["metadata"]["resourceVersion"] = str(self.version)
        self.put("workloads", workload)
        return copy.deepcopy(workload)

    def report(
        self, name: str, conditions: dict[str, tuple[str, str, str]], **status: object
    ) -> Json:
        """Kueue writes conditions, each (status, reason, message), and other fields."""
        found = self._found("workloads", name)
        old = {c["type"]: c for c in (found.get("status") or {}).get("conditions") or []}
        for type_, (true, reason, message) in conditions.items():
            old[type_] = {
                "type": type_, "status": true, "reason": reason, "message": message,
                "lastTransitionTime": SINCE,
            }  # fmt: skip
        found["status"] = (found.get("status") or {}) | status | {"conditions": [*old.values()]}
        return self._kept(found)


class QueueWorld(World):
    """A job in the queue nightly, and a watch of Workloads that delivers when the test says so."""

    api: FakeKueueApi

    def __init__(self, job: JobBuilder | None = None) -> None:
        self.workloads = Workloads()
        super().__init__(
            (job or make_job("x")).with_spec("queueName", "nightly").with_executors(3),
            Settings(kueue=True),
        )
        self.api = FakeKueueApi(objects=self.api.objects)
        self.reconciler = self.restarted(self.view)

    def restarted(self, view: View, **fields: Any) -> Reconciler:
        if isinstance(self.api, FakeKueueApi) and "queueing" not in fields:
            self.workloads = Workloads()
            fields["queueing"] = Queueing(
                self.api, self.workloads, self.settings, self.clock.now, self.clock.monotonic
            )
        return super().restarted(view, **fields)

    @property
    def name(self) -> str:
        """Of the one Workload."""
        [name] = self.api.named("workloads")
        return name

    def workload(self) -> Json:
        return self.api.objects["workloads", self.name]

    def condition(self, type_: str) -> str:
        """A condition of the Workload as status/reason."""
        reported = self.workload()["status"]["conditions"]
        found = next(c for c in reported if c["type"] == type_)
        return f"{found['status']}/{found['reason']}"

    def edit(self, **spec: object) -> None:
        """Somebody changes the job, and the watch brings it."""
        job = self.api.objects["jobs", "x"]
        self.api.version += 100
        job["spec"] |= spec
        job["metadata"]["generation"] += 1
        job["metadata"]["resourceVersion"] = str(self.api.version)
        self.deliver_job()

    async def put_off(self, message: str = "couldn't assign flavors to pod set driver") -> None:
        """Kueue has looked at the Workload and has no quota for it."""
        self._deliver({"QuotaReserved": ("False", "Pending", message)})
        await self.reconcile()

    async def admit(self, flavor: str = "default") -> None:
        """Kueue admits the Workload as a whole."""
        sets = [
            {"name": name, "count": count, "flavors": {"cpu": flavor, "memory": flavor}}
            for name, count in (("driver", 1), ("executors", 3))
        ]
        self._deliver(
            {
                "QuotaReserved": ("True", "QuotaReserved", "Quota reserved in ClusterQueue lab"),
                "Admitted": ("True", "Admitted", "The workload is admitted"),
                "Evicted": ("False", "QuotaReserved", ""),
            },
            admission={"clusterQueue": "lab", "podSetAssignments": sets},
        )
        await self.reconcile()

    async def evict(
        self, reason: str = "Preempted", message: str = "for what matters more"
    ) -> None:
        """Kueue wants the quota back."""
        self._deliver({"Evicted": ("True", reason, message)})
        await self.reconcile()

    def _deliver(self, conditions: dict[str, tuple[str, str, str]], **status: object) -> None:
        reported = self.api.report(self.name, conditions, **status)
        self.workloads.put(WorkloadView.from_object(reported))

    def flavor(self, name: str = "default", **spec: object) -> None:
        """A ResourceFlavor."""
        self.api.put("flavors", {"metadata": {"name": name}, "spec": spec})
