"""Jobs of a pool, an operator, and drivers that answer as the test says, over the fakes."""

import hashlib
import json
from typing import Any

from bagpipe_operator.api import names
from bagpipe_operator.api.objects import Json
from bagpipe_operator.jobs.driver.progress import Progress, parse
from bagpipe_operator.jobs.job_view import JobView
from bagpipe_operator.jobs.metrics import JobMetrics
from bagpipe_operator.jobs.pod_view import PodView
from bagpipe_operator.jobs.pools.handover import Received
from bagpipe_operator.jobs.reconcile import Reconciler
from bagpipe_operator.jobs.view import View
from bagpipe_operator.runtime.queue import WorkQueue
from bagpipe_operator.settings import Settings
from tests.unit.operator.builders import Clock, JobBuilder, account, make_executor, make_job
from tests.unit.operator.fakes import FakeApi

POOLS = Settings(pools=True, pool_idle_seconds=300.0, pools_per_namespace=2)
DRIVER = "uid-of-one-1-driver"


class Drivers:
    """The drivers' accounts, by the pods' UIDs, each of a job's attempt."""

    def __init__(self) -> None:
        self.says: dict[str, str] = {}
        self.silent = False

    async def read(self, uid: str, ip: str, whose: tuple[str, int]) -> Progress | None:  # noqa: ARG002
        progress = parse(self.says[uid]) if uid in self.says else None
        return progress if progress is not None and progress.is_of(*whose) else None

    async def works(self, ip: str) -> bool | None:  # noqa: ARG002
        last = list(self.says.values())[-1:]
        progress = parse(last[0]) if last and not self.silent else None
        return None if progress is None else not progress.ended

    def silent_seconds(self, uid: str) -> float:  # noqa: ARG002
        return 0.0

    def forget(self, uid: str) -> None: ...


class Offers:
    """What drivers answer, in turn; the last answer stands."""

    def __init__(self) -> None:
        self.answers: list[Received] = ["taken"]
        self.came: list[Json] = []
        self.digests: list[str] = []

    async def offer(self, ip: str, description: bytes) -> Received:
        assert ip == "10.0.0.5"
        self.came.append(json.loads(description))
        self.digests.append(hashlib.sha256(description).hexdigest())
        return self.answers.pop(0) if len(self.answers) > 1 else self.answers[0]


def pooled(name: str, pool: str = "lane") -> JobBuilder:
    return make_job(name).with_spec("spark.pool", pool)


class World:
    """Jobs of a namespace, an operator, and pods that run as soon as they are made."""

    def __init__(self, *jobs: JobBuilder, settings: Settings = POOLS) -> None:
        self.clock, self.api, self.view = Clock(), FakeApi(), View()
        self.settings, self.drivers, self.offers = settings, Drivers(), Offers()
        for job in jobs:
            self.create(job)
        self.restart()

    def restart(self, fresh: bool = False) -> None:
        if fresh:
            self.view = View()
            for kind, name in sorted(self.api.objects):
                if kind == "jobs":
                    self.view.put_job(JobView.from_object(self.api.objects[kind, name]))
                if kind == "pods":
                    self.view.put_pod(PodView.from_object(self.api.objects[kind, name]))
        self.metrics = JobMetrics(self.view, WorkQueue())
        self.reconciler = Reconciler(
            self.api, self.view, self.drivers, self.settings, self.clock.now,
            self.clock.monotonic, self.metrics.job_written, offers=self.offers,
        )  # fmt: skip

    def create(self, job: JobBuilder) -> None:
        self.api.put("jobs", job.object)
        self.view.put_job(job.view())

    async def visit(self, name: str, after: float = 0) -> None:
        self.clock.advance(after)
        await self.reconciler.reconcile(f"uid-of-{name}")

    def run(self, driver: str) -> None:
        """The kubelet starts a driver, and Spark an executor."""
        pod = self.api.objects["pods", driver]
        pod["status"] = {
            "phase": "Running",
            "podIP": "10.0.0.5",
            "containerStatuses": [{"name": "driver", "state": {"running": {}}}],
        }
        self.view.put_pod(PodView.from_object(pod))
        job = pod["metadata"]["labels"][names.LABEL_JOB]
        executor = make_executor(job).running().object()
        self.api.put("pods", executor)
        self.view.put_pod(PodView.from_object(executor))

    def says(self, job: str, phase: str = "Running", ended: bool = False, **more: Any) -> None:
        """The driver's account of a job."""
        self.drivers.says[DRIVER] = account(
            phase, uid=f"uid-of-{job}", attempt=1, ended=ended, **more
        )

    def status(self, name: str) -> Json:
        return dict(self.api.objects["jobs", name].get("status") or {})

    def reason(self, name: str, type_: str) -> str:
        found = next(c for c in self.status(name)["conditions"] if c["type"] == type_)
        return f"{found['status']}/{found['reason']}"

    def goes(self, pod: str) -> None:
        """A pod is gone, and its events are."""
        self.api.objects.pop(("pods", pod), None)
        for known in list(self.view.all_pods()):
            if known.name == pod:
                self.view.drop_pod(known)

    async def run_the_first(self) -> None:
        """Job `one` runs cold and is Complete; its driver waits."""
        await self.visit("one")
        self.run("one-1-driver")
        self.says("one")
        await self.visit("one", after=2)
        self.says("one", "Complete", ended=True, verdict="Passed", reason="AllCasesRan")
        await self.visit("one", after=2)

    def pods(self) -> list[str]:
        return self.api.named("pods")

    def suspend(self, name: str) -> None:
        """Somebody sets spec.suspend, and the watch brings it."""
        job = self.api.objects["jobs", name]
        job["spec"]["suspend"] = True
        self.api.version += 1
        job["metadata"]["resourceVersion"] = str(self.api.version)
        self.view.put_job(JobView.from_object(job))
