"""Jobs of a pool under random faults: the reconciler itself, with the drivers' own seats.

Whatever answer is lost and whoever dies, a job that exists is run by one driver at a time, ends by
its own account, and no driver that has a job is taken from it.
"""

import contextlib
import copy
import hashlib
import random
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import pytest

from bagpipe.driver.own_claim import _claim_in
from bagpipe.driver.seat import Claimed, Seat
from bagpipe.spec import JobFile
from bagpipe_operator.api import names
from bagpipe_operator.api.objects import Json
from bagpipe_operator.cluster.client import ApiError
from bagpipe_operator.jobs.driver.progress import Progress, parse
from bagpipe_operator.jobs.job_view import JobView
from bagpipe_operator.jobs.pod_view import PodView
from bagpipe_operator.jobs.pools.handover import Received
from bagpipe_operator.jobs.reconcile import Reconciler
from bagpipe_operator.jobs.view import View
from bagpipe_operator.settings import Settings
from tests.unit.bagpipe.offers import offer_of
from tests.unit.operator.builders import Clock, JobBuilder, account, make_job
from tests.unit.operator.fakes import FakeApi

POOLS = Settings(pools=True, pool_idle_seconds=60.0, pools_per_namespace=2)
JOBS = ("a", "b", "c", "d", "e", "f")


@dataclass
class Driver:
    """A driver's pod: its seat, what it runs or ran last, and who it says has ended."""

    pod: str
    uid: str
    ip: str
    waits: bool
    seat: Seat
    holds: tuple[str, int] | None
    reports: tuple[str, int]
    ended: bool = False


class Api(FakeApi):
    """Ends the pods that it deletes, and gives every write a version."""

    def __init__(self, world: "World") -> None:
        super().__init__()
        self.world = world

    async def create(self, resource: str, manifest: Json) -> Json:
        key = (resource, manifest["metadata"]["name"])
        before = key in self.objects
        try:
            await super().create(resource, manifest)
        finally:
            if key in self.objects and not before:
                self.version += 1
                meta = self.objects[key]["metadata"]
                meta |= {"uid": f"{key[1]}-{self.version}", "resourceVersion": str(self.version)}
        return copy.deepcopy(self.objects[key])

    async def delete_pod(
        self, namespace: str, name: str, uid: str, grace_seconds: int | None = None
    ) -> bool:
        self.world.check_deletion(name, uid)
        try:
            return await super().delete_pod(namespace, name, uid, grace_seconds)
        finally:
            if ("pods", name) not in self.objects:
                self.world.dies(uid)


@dataclass
class World:
    """The API server's truth, an operator that may be behind, and drivers."""

    rng: random.Random
    clock: Clock = field(default_factory=Clock)
    drivers: dict[str, Driver] = field(default_factory=dict)
    late: list[tuple[str, bytes]] = field(default_factory=list)
    answer: str = ""
    handed_over: int = 0

    def __post_init__(self) -> None:
        self.api, self.view = Api(self), View()
        for claim in ("recordings", "results"):
            meta = {"name": claim, "namespace": "lanes", "uid": claim}
            self.api.put("persistentvolumeclaims", {"metadata": meta})
        self.restart()

    def restart(self) -> None:
        self.view = View()
        self.deliver()
        self.reconciler = Reconciler(
            self.api, self.view, self, POOLS, self.clock.now, self.clock.monotonic, offers=self
        )

    # The drivers, as the operator asks them.

    async def read(self, uid: str, ip: str, whose: tuple[str, int]) -> Progress | None:
        driver = self.drivers.get(uid)
        if driver is None or driver.ip != ip:
            return None
        found = parse(self.account_of(driver))
        return found if found is not None and found.is_of(*whose) else None

    async def works(self, ip: str) -> bool | None:
        driver = next((d for d in self.drivers.values() if d.ip == ip), None)
        if driver is None:
            return None
        found = parse(self.account_of(driver))
        return None if found is None else not found.ended

    def account_of(self, driver: Driver) -> str:
        uid, attempt = driver.reports
        if driver.holds is None:
            return account(
                "Complete", uid=uid, attempt=attempt, ended=driver.ended, verdict="Passed",
                message=f"the end of {uid}",
            )  # fmt: skip
        return account("Running", uid=uid, attempt=attempt)

    def silent_seconds(self, uid: str) -> float:
        return 0.0 if uid in self.drivers else 60.0

    def forget(self, uid: str) -> None: ...

    async def offer(self, ip: str, description: bytes) -> Received:
        if self.answer == "late":
            self.late.append((ip, description))
            return "silent"
        given = self.deliver_offer(ip, description) if self.answer != "lost" else "silent"
        return "silent" if self.answer == "unread" else given

    def deliver_offer(self, ip: str, description: bytes) -> Received:
        driver = next((d for d in self.drivers.values() if d.ip == ip), None)
        if driver is None or not driver.waits:
            return "silent"
        job = JobFile.model_validate_json(description)
        given = driver.seat.offer(offer_of(job, hashlib.sha256(description).hexdigest()))
        if given == "taken" and driver.holds != (job.uid, job.attempt):
            assert driver.holds is None, f"{driver.pod} had {driver.holds} and took {job.uid}"
            self.handed_over += 1
            driver.holds = driver.reports = (job.uid, job.attempt)
            driver.ended = False
        return "silent" if given == "unknown" else given

    def look_up(self, name: str) -> Claimed | None:
        job = self.api.objects.get(("jobs", name))
        return _claim_in(job) if job is not None else None

    # What happens in the cluster.

    def deliver(self) -> None:
        """The watch brings all that it has not brought yet."""
        for (kind, _), found in sorted(self.api.objects.items()):
            if kind == "jobs":
                self.view.put_job(JobView.from_object(found))
            if kind == "pods":
                self.view.put_pod(PodView.from_object(found))
        there = {o["metadata"]["uid"] for (kind, _), o in self.api.objects.items()
                 if kind in {"jobs", "pods"}}  # fmt: skip
        for pod in list(self.view.all_pods()):
            if pod.uid not in there:
                self.view.drop_pod(pod)
        for uid in self.view.uids():
            if uid not in there:
                self.view.drop_job(uid)

    def create(self, job: JobBuilder) -> None:
        self.api.version += 1
        job.object["metadata"]["resourceVersion"] = str(self.api.version)
        self.api.put("jobs", job.object)

    def kubelet(self) -> None:
        """Pods that were made run."""
        for (kind, name), pod in list(self.api.objects.items()):
            uid = pod["metadata"]["uid"]
            if kind == "pods" and uid not in self.drivers and "status" not in pod:
                self.api.version += 1
                ip = f"10.0.{self.api.version // 250}.{self.api.version % 250}"
                self.patch(pod, phase="Running", podIP=ip, containerStatuses=[
                    {"name": "driver", "state": {"running": {}}}])  # fmt: skip
                labels = pod["metadata"]["labels"]
                key = labels[names.LABEL_JOB_UID], int(labels[names.LABEL_ATTEMPT])
                seat = Seat(uid, "lanes", 60.0, self.look_up, lambda: self.clock.seconds)
                waits = names.ANNOTATION_SHAPE in pod["metadata"].get("annotations", {})
                seat._current = _Held(*key)  # type: ignore[assignment]
                self.drivers[uid] = Driver(name, uid, ip, waits, seat, key, key)

    def patch(self, obj: Json, **status: Any) -> None:
        self.api.version += 1
        obj["status"] = obj.get("status", {}) | status
        obj["metadata"]["resourceVersion"] = str(self.api.version)

    def ends(self, driver: Driver) -> None:
        """Its job is Complete."""
        if driver.holds is None:
            return
        driver.holds = None
        driver.seat.leave(stays=driver.waits)
        driver.ended = driver.waits
        if not driver.waits:
            self.exits(driver)

    def exits(self, driver: Driver) -> None:
        pod = self.api.objects.get(("pods", driver.pod))
        del self.drivers[driver.uid]
        if pod is not None and pod["metadata"]["uid"] == driver.uid:
            state = {"terminated": {"exitCode": 0, "message": self.account_of(driver)}}
            self.patch(pod, phase="Succeeded",
                       containerStatuses=[{"name": "driver", "state": state}])  # fmt: skip

    def watches_claims(self) -> None:
        """A driver whose job is gone, or claims another, ends."""
        for driver in list(self.drivers.values()):
            pod = self.api.objects.get(("pods", driver.pod))
            if driver.holds is None or pod is None:
                continue
            if driver.holds[0] == pod["metadata"]["labels"][names.LABEL_JOB_UID]:
                continue
            job = self.job_of(driver.holds[0])
            claim = _claim_in(job) if job is not None else None
            if claim is None or (claim.attempt, claim.driver) != (driver.holds[1], driver.uid):
                self.dies(driver.uid)
                self.api.objects.pop(("pods", driver.pod), None)

    def idles(self) -> None:
        for driver in list(self.drivers.values()):
            if driver.holds is None and driver.seat._until <= self.clock.seconds:
                self.exits(driver)

    def dies(self, uid: str) -> None:
        self.drivers.pop(uid, None)

    def job_of(self, uid: str) -> Json | None:
        jobs = (o for (kind, _), o in self.api.objects.items() if kind == "jobs")
        return next((job for job in jobs if job["metadata"]["uid"] == uid), None)

    def delete_job(self, name: str) -> None:
        """The job goes, and what it owns with it."""
        job = self.api.objects.pop(("jobs", name), None)
        if job is None:
            return
        for key, pod in list(self.api.objects.items()):
            owners = pod["metadata"].get("ownerReferences") or []
            if key[0] == "pods" and any(o["uid"] == job["metadata"]["uid"] for o in owners):
                del self.api.objects[key]
                self.dies(pod["metadata"]["uid"])

    # What must hold.

    def check(self, event: str) -> None:
        held = [d.holds[0] for d in self.drivers.values() if d.holds is not None]
        twice = {uid for uid in held if held.count(uid) > 1 and self.job_of(uid) is not None}
        assert not twice, f"{event}: {twice} run twice"
        for (kind, name), job in self.api.objects.items():
            if kind != "jobs":
                continue
            for condition in (job.get("status") or {}).get("conditions") or []:
                if condition["type"] == "Complete" and condition["status"] == "True":
                    assert condition["message"] == f"the end of {job['metadata']['uid']}", name

    def check_deletion(self, name: str, uid: str) -> None:
        driver = self.drivers.get(uid)
        job = self.job_of(driver.holds[0]) if driver is not None and driver.holds else None
        if driver is None or job is None or driver.holds is None:
            return
        status = job.get("status") or {}
        conditions = status.get("conditions") or []
        suspending = any(condition["reason"] == "Suspending" for condition in conditions)
        suspended = job["spec"].get("suspend") or suspending
        fenced = (status.get("pool") or {}).get("state") == "Fenced"
        known = self.view.job(driver.holds[0])
        # The watch has not brought yet that it was taken.
        behind = known is None or known.resource_version != job["metadata"]["resourceVersion"]
        earlier = int(status.get("attempt") or 1) > driver.holds[1]
        assert suspended or fenced or earlier or behind, f"{name} was taken from {driver.holds}"


@dataclass(frozen=True)
class _Held:
    uid: str
    attempt: int


async def visit(world: World, name: str) -> None:
    """The operator looks at a job, with all that may go wrong meanwhile."""
    rng = world.rng
    world.answer = rng.choice(["", "", "", "", "late", "lost", "unread"])
    if rng.random() < 0.1:
        call = rng.choice(["patch status", "get pods", "create pods"])
        world.api.fail(call, ApiError(0, "Unreachable", "no answer"))
    if rng.random() < 0.1:
        world.api.lost.add(rng.choice(["patch status", "create pods", "delete pod"]))
    uid = world.api.objects.get(("jobs", name), {}).get("metadata", {}).get("uid", name)
    with contextlib.suppress(ApiError):
        await world.reconciler.reconcile(uid)


def end_one(world: World, _name: str) -> None:
    if world.drivers:
        world.ends(world.rng.choice(list(world.drivers.values())))


def kill_one(world: World, _name: str) -> None:
    if world.drivers:
        driver = world.rng.choice(list(world.drivers.values()))
        world.dies(driver.uid)
        world.api.objects.pop(("pods", driver.pod), None)


def bring_late_offers(world: World, _name: str) -> None:
    offers, world.late = world.late, []
    for ip, description in offers:
        world.deliver_offer(ip, description)


def wait(world: World, _name: str) -> None:
    world.clock.advance(world.rng.choice([1.0, 1.0, 2.0, 5.0, 5.0, 12.0, 70.0]))
    world.idles()


def suspend(world: World, name: str, wanted: bool = True) -> None:
    job = world.api.objects.get(("jobs", name))
    if job is not None:
        job["spec"]["suspend"] = wanted
        world.patch(job)


def create(world: World, name: str) -> None:
    if ("jobs", name) not in world.api.objects:
        made = make_job(name).with_spec("spark.pool", "lane").with_spec("backoffLimit", 10)
        world.api.version += 1
        made.object["metadata"]["uid"] = f"uid-of-{name}-{world.api.version}"
        world.create(made)


HAPPENINGS: dict[str, Callable[[World, str], object]] = {
    "watch": lambda world, _name: world.deliver(),
    "kubelet": lambda world, _name: world.kubelet(),
    "claims": lambda world, _name: world.watches_claims(),
    "restart": lambda world, _name: world.restart(),
    "delete": lambda world, name: world.delete_job(name),
    "resume": lambda world, name: suspend(world, name, wanted=False),
    "end": end_one,
    "die": kill_one,
    "offers": bring_late_offers,
    "wait": wait,
    "suspend": suspend,
    "create": create,
}


async def happen(world: World, event: str) -> None:
    name = world.rng.choice(JOBS)
    if event == "visit":
        await visit(world, name)
    else:
        HAPPENINGS[event](world, name)


EVENTS = (
    ["visit"] * 60 + ["watch"] * 24 + ["kubelet"] * 12 + ["end"] * 8 + ["wait"] * 6 + ["create"] * 6
    + ["offers"] * 4 + ["claims"] * 4 + ["delete"] * 2 + ["die", "restart", "suspend", "resume"]
)  # fmt: skip


async def played(seed: int) -> World:
    """The world after many events, each of which leaves it as it must be, and at rest."""
    world = World(random.Random(seed))  # noqa: S311  events, and no secret
    for _ in range(400):
        event = world.rng.choice(EVENTS)
        await happen(world, event)
        world.check(event)
    await settle(world)
    return world


@pytest.mark.parametrize("seed", range(30))
async def test_each_job_is_run_by_one_driver_at_a_time_and_ends_by_its_own_account(
    seed: int,
) -> None:
    world = await played(seed)
    for (kind, name), job in world.api.objects.items():
        if kind == "jobs":
            assert JobView.from_object(job).finished, (seed, name, job["status"])
    world.clock.advance(100.0)
    world.idles()
    assert world.drivers == {}


async def test_drivers_do_take_jobs_over_in_such_worlds() -> None:
    """Else the test above would show nothing: so it was when each job was refused for its spec."""
    assert sum([(await played(seed)).handed_over for seed in range(16)]) >= 13  # 14 today


async def settle(world: World) -> None:
    """No fault any more, and nobody suspended: every job comes to its end."""
    world.api.faults.clear()
    world.api.lost.clear()
    world.answer, world.late = "", []
    for (kind, _), job in world.api.objects.items():
        if kind == "jobs" and job["spec"].get("suspend"):
            job["spec"]["suspend"] = False
            world.patch(job)
    for _ in range(60):
        world.deliver()
        for (kind, _), job in list(world.api.objects.items()):
            if kind == "jobs":
                await world.reconciler.reconcile(job["metadata"]["uid"])
        world.check("at the end")
        world.kubelet()
        world.watches_claims()
        for driver in list(world.drivers.values()):
            world.ends(driver)
        world.clock.advance(11.0)
        world.idles()
