"""A job, an operator and a watch that delivers when the test says so, over the fakes."""

from typing import Any

from bagpipe_operator.api.objects import Json
from bagpipe_operator.jobs.job_view import JobView
from bagpipe_operator.jobs.reconcile import Reconciler
from bagpipe_operator.jobs.view import View
from bagpipe_operator.settings import Settings
from tests.unit.operator.builders import Clock, JobBuilder, PodBuilder, make_job
from tests.unit.operator.fakes import FakeApi, FakeDrivers

UID = "uid-of-x"


class World:
    """A job, an operator, and a watch that delivers when the test says so."""

    def __init__(self, job: JobBuilder | None = None, settings: Settings | None = None) -> None:
        self.settings = settings or Settings()
        self.clock = Clock()
        self.api = FakeApi()
        self.view = View()
        self.drivers = FakeDrivers()
        self.api.put("jobs", (job or make_job("x")).object)
        self.deliver_job()
        self.reconciler = self.restarted(self.view)

    def restarted(self, view: View, **fields: Any) -> Reconciler:
        parts: dict[str, Any] = {"drivers": self.drivers, "settings": self.settings} | fields
        clock = self.clock
        return Reconciler(self.api, view, now=clock.now, monotonic=clock.monotonic, **parts)

    def restart(self, **fields: Any) -> None:
        """The operator is another one, which sees the same."""
        self.reconciler = self.restarted(self.view, **fields)

    def forget_everything(self) -> None:
        """The operator is restarted, and its watch has delivered only the job so far."""
        self.view = View()
        self.deliver_job()
        self.reconciler = self.restarted(self.view)

    async def reconcile(self, after: float = 0) -> None:
        self.clock.advance(after)
        await self.reconciler.reconcile(UID)

    def deliver_job(self) -> None:
        self.view.put_job(JobView.from_object(self.api.objects["jobs", "x"]))

    def deliver(self, *pods: PodBuilder) -> None:
        """The kubelet and the watch: the pods' states reach the server and the view."""
        for pod in pods:
            self.api.put("pods", pod.object())
            self.view.put_pod(pod.view())

    def configs(self) -> list[str]:
        """The ConfigMaps' names, without what their names say of their content."""
        return [name.rpartition("-")[0] for name in self.api.named("configmaps")]

    def config(self, stem: str) -> Json:
        """The one ConfigMap whose name begins so."""
        [found] = [n for n in self.api.named("configmaps") if n.rpartition("-")[0] == stem]
        return self.api.objects["configmaps", found]

    def status(self) -> Json:
        status: Json = self.api.objects["jobs", "x"].get("status") or {}
        return status

    def reason(self, type_: str) -> str:
        found = next(c for c in self.status()["conditions"] if c["type"] == type_)
        return f"{found['status']}/{found['reason']}"

    def message(self, type_: str) -> str:
        found = next(c for c in self.status()["conditions"] if c["type"] == type_)
        return str(found["message"])
