"""The four loads of the operator's bench; each has a fresh cluster and returns what it measured."""

import asyncio
import random
import time
from dataclasses import dataclass
from pathlib import Path

import yaml

from bagpipe_operator.api import names
from tests.bench.operator_api import JOBS, Client, Object, all_of
from tests.bench.operator_drivers import answering
from tests.bench.operator_seen import Seen, until, watching
from tests.bench.operator_times import delays, percentile, rate
from tests.bench.operator_world import NAMESPACE, NODES, Operator, World, fresh

EXAMPLE = Path(__file__).parents[2] / "docs/examples/robot-state-publisher/job.yaml"
COLLECTION = JOBS.format(NAMESPACE)
PODS = f"/api/v1/namespaces/{NAMESPACE}/pods"
ALONE = 20  # jobs that are applied at once, as beside the peer
RATED = 200
PER_SECOND, STEADY_SECONDS = 5.0, 60.0
BURST, PLATEAU_SECONDS, SAMPLE_SECONDS = 1000, 30.0, 0.25
FINISHED, RUNNING, PODS_PER_JOB = 5000, 500, 10
SETTLED_SECONDS = 120
# A killed leader's Lease has to run out, so the jobs' lives are about as long as that.
COLLECTED_SECONDS = 120
CYCLES, CYCLES_AT_ONCE, LONGEST_LIFE = 1000, 50, 12.0


def job(name: str) -> Object:
    """The example's job, whose spec is a real robot's description of 8 KB; without its volumes,
    since there is nobody here who would make them."""
    made: Object = yaml.safe_load(EXAMPLE.read_text())
    made["metadata"] = {"name": name}
    made["spec"]["source"]["bags"] = ["s3://recordings/pr2/*.bag"]
    made["spec"]["output"] = {"uri": "s3://results/bench"}
    return made


async def creation_rate(count: int) -> tuple[float, float]:
    """(driver pods per second, seconds to the last) of jobs that are applied as fast as it goes."""
    async with (
        fresh() as world,
        answering(count) as drivers,
        watching(world.client, drivers) as seen,
    ):
        world.operator.start()
        await world.operator.ready()
        begun = await _apply([f"rate-{n:04d}" for n in range(count)], world.client)
        await until(f"{count} driver pods", lambda: len(seen.pod_created) == count, 120)
        ended = list(seen.pod_created.values())
        return rate(list(begun.values()), ended), max(ended) - min(begun.values())


async def _apply(jobs: list[str], client: Client) -> dict[str, float]:
    """Creates jobs at once; the moment at which each was asked for."""
    manifest = job("")
    begun: dict[str, float] = {}

    async def one(name: str) -> None:
        begun[name] = time.monotonic()
        await client.create(COLLECTION, manifest | {"metadata": {"name": name}})

    await all_of(one(name) for name in jobs)
    return begun


@dataclass(frozen=True)
class Steady:
    """At a steady rate: seconds from a job's creation, and the operator's share of a processor."""

    to_pod: list[float]
    to_accepted: list[float]
    processor: float


async def steady(per_second: float, seconds: float) -> Steady:
    """Jobs come one after the other, while those before them run."""
    count = round(per_second * seconds)
    async with (
        fresh() as world,
        answering(count) as drivers,
        watching(world.client, drivers) as seen,
    ):
        world.operator.start()
        await world.operator.ready()
        used, since = world.operator.processor_seconds(), time.monotonic()
        begun = await _come(world.client, count, per_second)
        await until(f"{count} jobs accepted", lambda: len(seen.accepted) == count, 60)
        used = world.operator.processor_seconds() - used
        return Steady(
            delays(begun, seen.pod_created),
            delays(begun, seen.accepted),
            used / (time.monotonic() - since),
        )


async def _come(client: Client, count: int, per_second: float) -> dict[str, float]:
    """Creates a job every 1 / per_second; the moment at which each was there."""
    manifest = job("")
    begun: dict[str, float] = {}
    first = time.monotonic()

    async def one(number: int) -> None:
        await asyncio.sleep(max(0.0, first + number / per_second - time.monotonic()))
        name = f"steady-{number:04d}"
        await client.create(COLLECTION, manifest | {"metadata": {"name": name}})
        begun[name] = time.monotonic()

    await asyncio.gather(*(one(number) for number in range(count)))
    return begun


@dataclass(frozen=True)
class Burst:
    """Of many jobs at once: how stale counts were, in samples, and how late all else was."""

    stale: list[float]
    accepted: list[float]
    late: list[float]
    faults: list[float]
    rate: float


async def burst(count: int) -> Burst:
    """All jobs at once; then they run, and each driver's account changes every second."""
    async with (
        fresh() as world,
        answering(count) as drivers,
        watching(world.client, drivers) as seen,
    ):
        world.operator.start()
        await world.operator.ready()
        sampling = asyncio.create_task(_sample(seen))
        begun = await _apply([f"burst-{n:04d}" for n in range(count)], world.client)
        await until(f"{count} drivers running", lambda: len(seen.pod_running) == count, 240)
        await asyncio.sleep(PLATEAU_SECONDS)
        sampling.cancel()
        await until(f"{count} faults", lambda: len(seen.fault_reported) == count, 60)
        await until(f"{count} reported", lambda: len(seen.running_reported) == count, 60)
        return Burst(
            seen.stale,
            delays(seen.pod_created, seen.accepted),
            delays(seen.pod_running, seen.running_reported),
            delays(seen.faulted, seen.fault_reported),
            rate(list(begun.values()), list(seen.pod_created.values())),
        )


async def _sample(seen: Seen) -> None:
    while True:
        seen.sample()
        await asyncio.sleep(SAMPLE_SECONDS)


@dataclass(frozen=True)
class Full:
    """With many jobs: seconds of a cold start and of its processor, MiB at most, seconds of
    /metrics then and later."""

    start: float
    processor: float
    peak: float
    metrics_at_start: list[float]
    metrics: list[float]


async def full(finished: int, running: int, pods_per_job: int) -> Full:
    """The operator starts among jobs that another one has left."""
    pods = running * pods_per_job
    async with fresh() as world, answering(pods) as drivers:
        await _fill(world.client, finished, running, pods_per_job)
        async with watching(world.client, drivers) as seen:
            # The bench's own beginning must not take the processor from the operator's.
            await until(f"{running} drivers run", lambda: len(seen.pod_running) == running, 120)
            begun = time.monotonic()
            world.operator.start()
            at_start = await _settled(world.operator, finished + running, pods)
            took, used = time.monotonic() - begun, world.operator.processor_seconds()
            later = []
            for _ in range(50):
                asked = time.monotonic()
                await world.operator.ask("/metrics")
                later.append(time.monotonic() - asked)
                await asyncio.sleep(0.1)
            return Full(took, used, world.operator.peak_mib(), at_start, later)


async def _settled(operator: Operator, jobs: int, pods: int) -> list[float]:
    """Waits until every object was seen and every job looked at; the times of /metrics."""
    times, deadline = [], time.monotonic() + SETTLED_SECONDS
    known = there = done = 0.0
    while time.monotonic() < deadline:
        asked = time.monotonic()
        status, text = await operator.ask("/metrics")
        if status == 200:
            times.append(time.monotonic() - asked)
            known = sum(metric(text, "bagpipe_jobs{"))
            there = sum(metric(text, "bagpipe_pods{"))
            done = sum(metric(text, 'bagpipe_reconciles_total{result="done"}'))
            if known == jobs and there == pods and done >= jobs:
                return times
        await asyncio.sleep(0.1)
    raise TimeoutError(
        f"after {SETTLED_SECONDS} s the operator knows {known:.0f} of {jobs} jobs and {there:.0f} "
        f"of {pods} pods, and has looked at jobs {done:.0f} times; its log ends with: "
        f"{operator.log.read_text(errors='replace')[-1000:]}"
    )


def metric(text: str, start: str) -> list[float]:
    """The values of all samples in Prometheus' text form whose lines begin so."""
    return [float(line.split()[-1]) for line in text.splitlines() if line.startswith(start)]


async def _fill(client: Client, finished: int, running: int, pods_per_job: int) -> None:
    """Creates jobs that have ended, jobs that run, and the pods of these."""
    manifest = job("")

    async def ended(number: int) -> None:
        name = f"ended-{number:04d}"
        await client.create(COLLECTION, manifest | {"metadata": {"name": name}})
        await client.set_status(f"{COLLECTION}/{name}", ended_status(name))

    async def runs(number: int) -> None:
        name = f"runs-{number:04d}"
        made = await client.create(COLLECTION, manifest | {"metadata": {"name": name}})
        uid = made["metadata"]["uid"]
        await client.set_status(f"{COLLECTION}/{name}", running_status(name))
        for pod in range(pods_per_job):
            await client.create(PODS, pod_of(name, uid, pod))

    await all_of(ended(number) for number in range(finished))
    await all_of(runs(number) for number in range(running))


def ended_status(name: str) -> Object:
    """What a completed job's status says."""
    now = "2026-11-20T04:00:00Z"
    return {
        "observedGeneration": 1, "attempt": 1, "phase": "Complete", "startTime": now,
        "completionTime": now, "driver": names.driver_name(name, 1), "verdict": "Passed",
        "results": f"s3://results/{name}", "cases": {"planned": 96, "passed": 96},
        "conditions": [
            _condition("Accepted", True, "DriverCreated"), _condition("Running", False, "Finished"),
            _condition("Complete", True, "CasesPassed"), _condition("Failed", False, "Complete"),
        ],
    }  # fmt: skip


def running_status(name: str) -> Object:
    """What a running job's status says."""
    return {
        "observedGeneration": 1, "attempt": 1, "phase": "Running", "driver":
        names.driver_name(name, 1), "startTime": "2026-11-20T04:00:00Z",
        "conditions": [_condition("Accepted", True, "DriverCreated")],
    }  # fmt: skip


def _condition(kind: str, true: bool, reason: str) -> Object:
    return {
        "type": kind, "status": str(true), "reason": reason, "message": "As the bench made it.",
        "lastTransitionTime": "2026-11-20T04:00:00Z",
    }  # fmt: skip


def pod_of(name: str, uid: str, number: int) -> Object:
    """A job's driver (number 0) or one of its executors, with a node, for KWOK to run."""
    role = names.ROLE_EXECUTOR if number else names.ROLE_DRIVER
    called = (
        f"{names.attempt_name(name, 1)}-exec-{number}" if number else names.driver_name(name, 1)
    )
    container = names.CONTAINER_SPARK if number else names.CONTAINER_DRIVER
    return {
        "metadata": {
            "name": called,
            "labels": names.labels(name, uid, role, 1),
            "ownerReferences": [names.owner_reference(name, uid)],
        },
        "spec": {
            "nodeName": f"kwok-{number % NODES}",
            "serviceAccountName": "bagpipe-driver",
            "containers": [{"name": container, "image": "example/image:1"}],
        },
    }


@dataclass(frozen=True)
class Cycles:
    """Of create and delete under kills: objects that were left, and how often it was killed."""

    left: int
    kills: int


async def cycles(count: int, seed: int = 0) -> Cycles:
    """Jobs are created and deleted at random moments while the operator is killed at others."""
    chance = random.Random(seed)  # noqa: S311  no secret
    manifest = job("")
    async with fresh() as world, answering(count) as drivers:
        async with watching(world.client, drivers):
            world.operator.start()
            await world.operator.ready()
            killing = asyncio.create_task(_kill_again_and_again(world.operator, chance))

            async def one(number: int) -> None:
                name = f"cycle-{number:04d}"
                await world.client.create(COLLECTION, manifest | {"metadata": {"name": name}})
                await asyncio.sleep(chance.random() * LONGEST_LIFE)
                await world.client.delete(f"{COLLECTION}/{name}")

            await all_of((one(number) for number in range(count)), CYCLES_AT_ONCE)
            killing.cancel()
            (kills,) = await asyncio.gather(killing)
        if not world.operator.server.alive:
            world.operator.start()
        await world.operator.ready()
        return Cycles(await _left(world), kills)


async def _kill_again_and_again(operator: Operator, chance: random.Random) -> int:
    """Kills a ready operator at random moments until cancelled; how often."""
    kills = 0
    try:
        while True:
            await operator.ready()
            await asyncio.sleep(chance.random() * 5)
            operator.kill()
            kills += 1
            operator.start()
    except asyncio.CancelledError:
        return kills


async def _left(world: World) -> int:
    """Objects that are left once the garbage collector has had its time, or 0 before that."""
    deadline = time.monotonic() + COLLECTED_SECONDS
    while True:
        found = [
            f"{kind}/{each['metadata']['name']}"
            for kind, path in (
                ("job", COLLECTION),
                ("pod", PODS),
                ("configmap", f"/api/v1/namespaces/{NAMESPACE}/configmaps"),
            )
            for each in await world.client.items(path)
            if each["metadata"]["name"] != "kube-root-ca.crt"
        ]
        if not found or time.monotonic() > deadline:
            return len(found)
        await asyncio.sleep(0.5)


def p50(values: list[float]) -> float:
    """The median."""
    return percentile(values, 0.5)


def p99(values: list[float]) -> float:
    """The 99th percentile."""
    return percentile(values, 0.99)
