"""Whatever stands in a job, a schedule, their statuses and pods: the operator decides, or refuses.

The unit-level twin of `make fuzz TARGET=manifests`: the same manifests through the real deciders
over a fake API server. Nothing but an ApiError may come out of them, as towards a real one.
"""

import copy
import json
import random
import time
from dataclasses import dataclass, field
from datetime import UTC, datetime

import pytest
from prometheus_client import CollectorRegistry, generate_latest

from bagpipe_operator.api.objects import Json
from bagpipe_operator.cluster.client import ApiError
from bagpipe_operator.jobs.job_view import JobView
from bagpipe_operator.jobs.metrics import JobMetrics
from bagpipe_operator.jobs.pods.job_config import UnusableSpecError, read_spec
from bagpipe_operator.jobs.reconcile import Reconciler
from bagpipe_operator.jobs.sweep import Sweeper
from bagpipe_operator.jobs.view import View
from bagpipe_operator.jobs.watch import Watch
from bagpipe_operator.runtime.queue import WorkQueue
from bagpipe_operator.schedules.alarms import Alarms
from bagpipe_operator.schedules.metrics import ScheduleMetrics
from bagpipe_operator.schedules.reconcile import ScheduleReconciler
from bagpipe_operator.schedules.view import Schedules
from bagpipe_operator.schedules.watch import ScheduleWatch
from bagpipe_operator.settings import Settings
from tests.fuzz.manifests import forged
from tests.fuzz.manifests import schema as schemas
from tests.fuzz.manifests.generator import JOB, SCHEDULE, Manifest, Mutation, seeded
from tests.unit.operator.builders import Clock
from tests.unit.operator.fakes import FakeApi, FakeDrivers
from tests.unit.operator.schedules import world as schedules

JOBS = 800
SCHEDULES = 600
# No decision takes a hundredth of it; a machine may have much else to do.
PATIENCE_SECONDS = 20.0
UID = "uid-of-fuzzed"
CREATED = "2026-11-20T04:00:00Z"


def stored(manifest: Manifest, uid: str, status: Json | None = None) -> Json:
    """The object as a watch delivers it; a status that is None is absent."""
    made: Json = json.loads(json.dumps(manifest.object))
    made["metadata"] |= {
        "name": "fuzzed", "namespace": "lanes", "uid": uid, "generation": 2,
        "resourceVersion": "7", "creationTimestamp": CREATED,
    }  # fmt: skip
    return made if status is None else made | {"status": status}


@dataclass
class JobWorld:
    """An operator with one job, whose watch hands on what is put before it."""

    rng: random.Random
    api: FakeApi = field(default_factory=FakeApi)
    clock: Clock = field(default_factory=Clock)
    view: View = field(default_factory=View)

    def __post_init__(self) -> None:
        queue = WorkQueue(lambda: 0.0)
        self.metrics = JobMetrics(self.view, queue)
        self.watch = Watch(self.view, queue, self.metrics)
        self.sweeper = Sweeper(self.view, queue, 2.0, now=self.clock.now)
        says = forged.account(self.rng)
        self.reconciler = Reconciler(
            self.api, self.view, FakeDrivers(says), Settings(), self.clock.now,
            self.clock.monotonic, counted=self.metrics.job_written,
        )  # fmt: skip

    async def live(self, job: Json) -> None:
        """The job is seen, worked on, given pods that somebody forged, and worked on again."""
        self.api.put("jobs", job)
        self.watch.job_event({"type": "ADDED", "object": copy.deepcopy(job)})
        for _ in range(self.rng.randrange(3)):
            self._deliver(self._forged())
        for seconds in (0, 20, 40):
            self.clock.advance(seconds)
            await self._visit()
            self._claim_driver()
        generate_latest(self.metrics.registry)
        self.watch.job_event({"type": "DELETED", "object": copy.deepcopy(job)})

    async def _visit(self) -> None:
        try:
            await self.reconciler.reconcile(UID)
        except ApiError as error:
            assert error.status in {404, 409}, error
        self.sweeper.sweep()

    def _forged(self) -> Json:
        pod: Json = forged.pod(self.rng, "fuzzed", UID)
        pod["metadata"] |= {"namespace": "lanes", "uid": f"uid-of-{pod['metadata']['name']}"}
        return pod | {"status": forged.pod_status(self.rng)}

    def _claim_driver(self) -> None:
        """The driver's pod gets a status that somebody else than a kubelet wrote."""
        for name in self.api.named("pods"):
            if self.rng.random() < 0.7:
                pod = copy.deepcopy(self.api.objects["pods", name])
                self._deliver(pod | {"status": forged.pod_status(self.rng)})

    def _deliver(self, pod: Json) -> None:
        self.api.put("pods", pod)
        self.watch.pod_event({"type": "MODIFIED", "object": copy.deepcopy(pod)})


async def run_job(number: int, lax: bool) -> tuple[bool, tuple[Mutation, ...]]:
    """One job from its creation on; whether its spec can be run, and what was changed in it."""
    generator = seeded(number, lax)
    manifest = generator.manifest(JOB)
    status = generator.status(JOB) if number % 2 else None
    job = stored(manifest, UID, status)
    try:
        read_spec(JobView.from_object(copy.deepcopy(job)))
        usable = True
    except UnusableSpecError:
        usable = False
    await JobWorld(generator.rng).live(job)
    return usable, manifest.mutations


async def run_schedule(number: int, lax: bool) -> None:
    """One schedule, with jobs that it may have made, and a run that may be due."""
    generator = seeded(number, lax)
    status = generator.status(SCHEDULE) if number % 2 else None
    schedule = stored(generator.manifest(SCHEDULE), schedules.UID, status)
    api = schedules.FakeApi(schedule)
    view, queue, registry = Schedules(), WorkQueue(lambda: 0.0), CollectorRegistry()
    watch = ScheduleWatch(view, queue, JobMetrics(View(), queue))

    def now() -> datetime:
        return datetime(2026, 11, 20, 4, 30, tzinfo=UTC)

    metrics = ScheduleMetrics(view, registry)
    reconciler = ScheduleReconciler(api, view, Alarms(queue, now), metrics, now)
    watch.schedule_event({"type": "ADDED", "object": copy.deepcopy(schedule)})
    for minute in range(generator.rng.randrange(3)):
        job = schedules.make_job(schedules.name_of(minute)) | {"status": generator.status(JOB)}
        job["metadata"]["ownerReferences"][0]["uid"] = schedules.UID
        api.jobs[job["metadata"]["name"]] = job
        watch.job_event({"type": "ADDED", "object": copy.deepcopy(job)})
    for _ in range(2):
        try:
            await reconciler.reconcile(schedules.UID)
        except ApiError as error:
            assert error.status in {404, 409, 422}, error
    generate_latest(registry)


@pytest.mark.parametrize("lax", [False, True], ids=["crd", "any-crd"])
async def test_no_job_and_none_of_its_pods_stops_the_operator(lax: bool) -> None:
    usable, mutated, slowest = 0, set(), 0.0
    for number in range(JOBS):
        begun = time.process_time()
        try:
            fit, done = await run_job(number, lax)
        except Exception as error:
            raise AssertionError(f"run_job({number}, {lax}) raised {error!r}") from error
        slowest = max(slowest, time.process_time() - begun)
        usable += fit
        mutated |= {mutation.what for mutation in done}
    # The operator's own rules are stricter than admission's.
    assert usable / JOBS >= (0.1 if lax else 0.3)
    assert slowest < PATIENCE_SECONDS
    assert mutated == {"valid", "hostile", "wrong", "remove", "null", "unknown"}


@pytest.mark.parametrize("lax", [False, True], ids=["crd", "any-crd"])
async def test_no_schedule_and_none_of_its_jobs_stops_the_operator(lax: bool) -> None:
    for number in range(SCHEDULES):
        try:
            await run_schedule(number, lax)
        except Exception as error:
            raise AssertionError(f"run_schedule({number}, {lax}) raised {error!r}") from error


@pytest.mark.parametrize("kind", [JOB, SCHEDULE])
def test_every_place_of_the_schema_is_changed(kind: str) -> None:
    generator = seeded(1)
    everywhere = set(schemas.places_of(kind, "spec"))
    assert len(everywhere) >= 400
    changed = {
        mutation.place
        for _ in range(3 * len(everywhere))
        for mutation in generator.manifest(kind).mutations
    }
    assert everywhere - changed == set()


def test_a_seed_gives_the_same_manifests() -> None:
    def some(seed: int) -> str:
        generator = seeded(seed)
        made = [generator.manifest().object for _ in range(20)]
        return json.dumps([*made, generator.status(JOB), forged.pod_status(generator.rng)])

    assert some(7) == some(7)
    assert some(7) != some(8)
