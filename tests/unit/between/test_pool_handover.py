"""Jobs are handed to waiting drivers by operators that may be behind, in any order of events:
each runs on one driver or cold, and never on both.
"""

from dataclasses import dataclass, field, replace
from datetime import timedelta
from typing import NamedTuple

from hypothesis import example, given, settings
from hypothesis import strategies as st

from bagpipe.driver.seat import Claimed, Seat
from bagpipe_operator.jobs.claim import Claim
from bagpipe_operator.jobs.pools.handover import Act, Received, step
from bagpipe_operator.jobs.pools.warm import Cold, Pooling, WarmDriver, Wish, chosen
from tests.unit.bagpipe.jobs import make_job
from tests.unit.bagpipe.offers import offer_of
from tests.unit.operator.builders import START

OVER = {"cold", "replaced", "ended"}
JOBS, DRIVERS, LEADERS = ("a", "b", "c"), ("d", "e"), ("one", "two")
POOLING = Pooling(enabled=True, idle_seconds=60.0, per_namespace=2)
WISH = Wish("lab", "nightly", "shape")
BASE = make_job({})

EVENTS = [
    *(f"{leader} sees" for leader in LEADERS),
    *(f"{leader} leads {job}" for leader in LEADERS for job in JOBS),
    # The offer comes at once, late or never; its answer comes back, gets lost, or waits to be read.
    *(f"{leader} leads {job} {how}" for leader in LEADERS for job in JOBS
      for how in ("unanswered", "late", "lost", "slowly")),
    "late offers come", "wait 5", "wait 12", "wait 70", "storage is away", "storage is back",
    *(f"{driver} {what}" for driver in DRIVERS for what in ("ends", "dies")),
    *(f"{job} is deleted" for job in JOBS),
]  # fmt: skip


class JobState(NamedTuple):
    """A job's status; `mode` is where it runs, as far as it is written."""

    version: int = 0
    claim: Claim | None = None
    mode: str = "new"  # claims, runs, cold, replaced, ended


@dataclass
class Driver:
    """A pod of the pool."""

    seat: Seat
    alive: bool = True
    holds: str | None = None
    idle_since: float = 0.0


@dataclass
class World:
    """The API server's truth, what each leader has last seen of it, and the drivers."""

    now: float = 0.0
    away: bool = False
    jobs: dict[str, JobState] = field(default_factory=lambda: {job: JobState() for job in JOBS})
    seen: dict[str, dict[str, JobState]] = field(default_factory=dict)
    drivers: dict[str, Driver] = field(default_factory=dict)
    cold: list[str] = field(default_factory=list)
    ran: list[tuple[str, str]] = field(default_factory=list)
    late: list[tuple[str, str]] = field(default_factory=list)
    unread: dict[tuple[str, str], Received] = field(default_factory=dict)

    def __post_init__(self) -> None:
        for name in DRIVERS:
            seat = Seat(name, "lab", POOLING.idle_seconds, self.look_up, lambda: self.now)
            self.drivers[name] = Driver(seat)
        self.seen = {leader: dict(self.jobs) for leader in LEADERS}

    def look_up(self, job: str) -> Claimed | None:
        if self.away:
            raise OSError("away")
        state = self.jobs.get(job)
        if state is None or state.claim is None:
            return None
        return Claimed(f"uid-{job}", 1, state.claim.driver, "digest")

    def write(self, leader: str, job: str, claim: Claim | None, mode: str) -> bool:
        """A patch with the version that was decided on; a conflict is a look at the job."""
        before, live = self.seen[leader][job], self.jobs.get(job)
        if live is None or live.version != before.version:
            self.look(leader, job)
            return False
        if (live.claim, live.mode) == (claim, mode):
            return True  # nothing changes, so nothing is written
        self.jobs[job] = JobState(live.version + 1, claim, mode)
        self.look(leader, job)
        return True

    def look(self, leader: str, job: str) -> None:
        if job in self.jobs:
            self.seen[leader][job] = self.jobs[job]
        else:
            self.seen[leader].pop(job, None)

    def deliver(self, job: str, name: str) -> Received:
        """An offer arrives at a driver."""
        driver = self.drivers[name]
        if not driver.alive:
            return "gone"
        wanted = BASE.model_copy(update={"name": job, "uid": f"uid-{job}"})
        answer = driver.seat.offer(offer_of(wanted))
        if answer == "unknown":
            return "silent"
        if answer == "taken" and driver.holds != job:
            assert driver.holds is None, f"{job} took {name} from {driver.holds}"
            driver.holds = job
            self.ran.append((job, name))
        return answer

    def warm_as_seen(self, leader: str) -> list[WarmDriver]:
        """A leader knows promises by the jobs that it has seen, and pods by their watch."""
        live = [s for s in self.seen[leader].values() if s.mode not in OVER]
        promised = {s.claim.driver for s in live if s.claim is not None}
        return [
            WarmDriver(
                name, "lab", "nightly", "shape",
                None if name in promised else START + timedelta(seconds=driver.idle_since),
            )
            for name, driver in self.drivers.items()
            if driver.alive
        ]  # fmt: skip

    def lead(self, leader: str, job: str, how: str) -> None:
        """One visit of a leader to a job."""
        state = self.seen[leader].get(job)
        if state is None or state.mode in OVER:
            return
        now = START + timedelta(seconds=self.now)
        if state.claim is None:
            found = chosen(WISH, self.warm_as_seen(leader), POOLING, now)
            if isinstance(found, Cold):
                if self.write(leader, job, None, "cold"):
                    self.cold.append(job)
            else:
                self.write(leader, job, Claim(found.uid, now), "claims")
            return
        received = self.unread.pop((leader, job), None) or self.received(
            job, state.claim.driver, how
        )
        if how == "slowly":
            self.unread[leader, job] = received
            return
        taken = step(state.claim, received, now)
        modes: dict[Act, str] = {
            "cold": "cold", "replace": "replaced", "run": "runs", "read": "ended",
        }  # fmt: skip
        if not self.write(leader, job, taken.claim, modes.get(taken.act, "claims")):
            return
        if taken.act == "delete":
            self.die(state.claim.driver)
        if taken.act == "cold":
            self.cold.append(job)

    def received(self, job: str, name: str, how: str) -> Received:
        if not self.drivers[name].alive:
            return "gone"
        if how == "late":
            self.late.append((job, name))
        if how in {"late", "lost"}:
            return "silent"
        answer = self.deliver(job, name)
        return "silent" if how == "unanswered" else answer

    def die(self, name: str) -> None:
        self.drivers[name].alive, self.drivers[name].holds = False, None

    def end(self, name: str) -> None:
        """The job of a driver comes to its end; nobody has written so yet."""
        driver = self.drivers[name]
        if not driver.alive or driver.holds is None:
            return
        driver.holds = None
        driver.seat.leave(stays=True)
        driver.idle_since = self.now


def happen(world: World, event: str) -> None:
    match event.split():
        case [leader, "sees"]:
            world.seen[leader] = dict(world.jobs)
        case [leader, "leads", job, *how]:
            world.lead(leader, job, how[0] if how else "")
        case ["late", "offers", "come"]:
            offers, world.late = world.late, []
            for job, name in offers:
                world.deliver(job, name)
        case ["wait", seconds]:
            world.now += float(seconds)
        case ["storage", "is", where]:
            world.away = where == "away"
        case [name, "ends"]:
            world.end(name)
        case [name, "dies"]:
            world.die(name)
        case [job, "is", "deleted"]:
            world.jobs.pop(job, None)


def check(world: World, event: str) -> None:
    held = [driver.holds for driver in world.drivers.values() if driver.alive and driver.holds]
    assert len(held) == len(set(held)), event
    assert len(world.cold) == len(set(world.cold)), event
    assert not set(held) & set(world.cold), event
    ran = dict(world.ran)
    assert len(ran) == len(world.ran), event
    assert not any(world.drivers[ran[job]].alive for job in set(world.cold) & set(ran)), event


@given(st.lists(st.sampled_from(EVENTS), max_size=40))
@example(["one leads a", "two leads b", "one leads a", "two sees", "two leads b"])
@example(["one leads a", "one leads a late", "wait 12", "one leads a lost", "late offers come"])
@example(["one leads a", "one leads a unanswered", "d ends", "one leads a"])
@example(
    [
        "one leads a",
        "two leads b",
        "one leads a",
        "two leads b slowly",
        "d ends",
        "one sees",
        "one leads b unanswered",
        "two leads b",
    ]
)
@settings(max_examples=400, deadline=None)
def test_each_job_runs_on_one_driver_or_cold_and_none_is_forgotten(events: list[str]) -> None:
    world = World()
    for event in events:
        happen(world, event)
        check(world, event)
    # Whatever has happened, one leader that sees what is there brings every job to a place.
    world.away = False
    world.unread.clear()
    for _ in range(4):
        happen(world, "one sees")
        for job in JOBS:
            happen(world, f"one leads {job}")
            check(world, "at the end")
        world.now += 12
    for job, state in world.jobs.items():
        assert state.mode in {"runs", *OVER}, (job, state)
        if state.mode == "runs":
            assert state.claim is not None
            assert world.drivers[state.claim.driver].holds == job
        assert (state.mode == "cold") == (job in world.cold)
        assert state.mode != "ended" or job in dict(world.ran)


def test_the_same_driver_runs_one_job_after_the_other() -> None:
    world = World()
    world.drivers = {"d": replace(world.drivers["d"])}
    for job in JOBS:
        happen(world, "one sees")
        happen(world, f"one leads {job}")
        happen(world, f"one leads {job}")
        assert world.ran[-1] == (job, "d")
        happen(world, "d ends")
        happen(world, f"one leads {job}")
    assert world.cold == []
    assert [job for job, _ in world.ran] == ["a", "b", "c"]
