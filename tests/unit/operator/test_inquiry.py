"""Drivers are asked in time whatever the visits of their jobs wait for, and only then."""

import asyncio
from collections.abc import Callable
from typing import Any

from bagpipe_operator.jobs.driver.progress import Progress, ProgressReader, parse
from bagpipe_operator.jobs.inquiry import Inquiry
from tests.unit.operator import virtual_time
from tests.unit.operator.builders import account

SWEEP = 2.0


def now() -> float:
    return asyncio.get_running_loop().time()


class Drivers(ProgressReader):
    """Each address answers as it is given; one that begins with `hangs` does so after 2 s."""

    def __init__(self) -> None:
        session: Any = None
        super().__init__(session, 2.0)
        self.asked: list[tuple[str, float]] = []
        self.says: dict[str, str] = {}

    async def _ask(self, ip: str) -> Progress | None:
        self.asked.append((ip, now()))
        if ip.startswith("hangs"):
            await asyncio.sleep(self.deadline_seconds)
            return None
        return parse(self.says.get(ip, account()))

    def times(self, ip: str) -> list[float]:
        return [round(at, 2) for who, at in self.asked if who == ip]


def inquiring(
    drivers: Drivers, news: Callable[[str], None], leads: Callable[[], bool] = lambda: True
) -> "asyncio.Task[None]":
    """The job of `<namespace>-1` is in that namespace."""
    of = Inquiry(drivers, SWEEP, lambda job: job.partition("-")[0], news, leads)
    return asyncio.create_task(of.run())


async def visit(drivers: Drivers, job: str, ip: str = "a") -> None:
    await drivers.read(f"pod-of-{job}", ip, (job, 1))


def cases(**counts: int) -> str:
    return account(cases={"planned": 40, "running": 2} | counts)


def test_a_driver_that_no_visit_asks_is_asked_and_only_a_fault_asks_for_a_visit() -> None:
    async def run() -> None:
        drivers, visits = Drivers(), list[str]()
        drivers.says["a"] = cases(passed=1)
        await visit(drivers, "ours-1")
        asking = inquiring(drivers, visits.append)
        drivers.says["a"] = cases(passed=9)
        await asyncio.sleep(10)
        assert drivers.times("a") == [0, 2.5, 5, 7.5]
        assert visits == []
        drivers.says["a"] = cases(passed=9, failed=1)
        await asyncio.sleep(1)
        assert visits == ["ours-1"]
        await visit(drivers, "ours-1")
        await asyncio.sleep(10)
        assert visits == ["ours-1"]
        asking.cancel()

    virtual_time.run(run())


def test_a_driver_that_visits_ask_in_time_is_not_asked_besides() -> None:
    async def run() -> None:
        drivers, visits = Drivers(), list[str]()
        asking = inquiring(drivers, visits.append)
        for _ in range(10):
            await visit(drivers, "ours-1")
            await asyncio.sleep(SWEEP)
        assert len(drivers.asked) == 10
        asking.cancel()

    virtual_time.run(run())


def test_the_first_answer_is_news_and_a_driver_that_is_over_is_not_asked() -> None:
    async def run() -> None:
        drivers, visits = Drivers(), list[str]()
        drivers.says["a"] = "not yet"
        await visit(drivers, "ours-1")
        asking = inquiring(drivers, visits.append)
        await asyncio.sleep(3)
        assert visits == []
        drivers.says["a"] = account()
        await asyncio.sleep(3)
        assert visits == ["ours-1"]
        drivers.forget("pod-of-ours-1")
        known = len(drivers.asked)
        await asyncio.sleep(10)
        assert len(drivers.asked) == known
        asking.cancel()

    virtual_time.run(run())


def test_who_does_not_lead_asks_no_driver() -> None:
    async def run() -> None:
        drivers, visits = Drivers(), list[str]()
        await visit(drivers, "ours-1")
        asking = inquiring(drivers, visits.append, leads=lambda: False)
        await asyncio.sleep(10)
        assert len(drivers.asked) == 1
        asking.cancel()

    virtual_time.run(run())


def test_drivers_that_hang_hold_up_those_of_their_own_namespace_alone() -> None:
    async def run() -> None:
        drivers, visits = Drivers(), list[str]()
        for number in range(100):
            pod = f"pod-{number}"
            await asyncio.gather(drivers.read(pod, f"quick-{number}", (f"theirs-{number}", 1)))
        drivers.asked.clear()
        for number in range(100):  # from now on nobody answers there
            drivers._answers[f"pod-{number}"].ip = f"hangs-{number}"
        await visit(drivers, "ours-1")
        asking = inquiring(drivers, visits.append)
        await asyncio.sleep(30)
        gaps = [b - a for a, b in zip(drivers.times("a"), drivers.times("a")[1:], strict=False)]
        assert len(gaps) > 10
        assert max(gaps) <= 2.76
        begun = [at for ip, at in drivers.asked if ip.startswith("hangs")]
        # Three quarters of those that ask.
        assert len(begun) == 30 / drivers.deadline_seconds * 24 - 24
        asking.cancel()

    virtual_time.run(run())


def test_a_driver_that_stays_silent_is_left_to_visits() -> None:
    """Its pod may be gone, and its address another pod's."""

    async def run() -> None:
        drivers, visits = Drivers(), list[str]()
        await visit(drivers, "ours-1")
        drivers.says["a"] = "no account"
        asking = inquiring(drivers, visits.append)
        await asyncio.sleep(60)
        known = len(drivers.asked)
        assert 28 < drivers.asked[-1][1] < 34
        drivers.says["a"] = account()
        await visit(drivers, "ours-1")
        await asyncio.sleep(10)
        assert len(drivers.asked) > known + 2
        asking.cancel()

    virtual_time.run(run())


def test_a_question_that_is_under_way_is_not_asked_twice_and_a_visit_does_not_wait_for_it() -> None:
    async def run() -> None:
        drivers = Drivers()
        await visit(drivers, "ours-1")
        drivers._answers["pod-of-ours-1"].ip = "hangs"
        await asyncio.sleep(5)
        asking = asyncio.create_task(drivers.ask("pod-of-ours-1"))
        await asyncio.sleep(1.9)
        begun = now()
        assert await drivers.read("pod-of-ours-1", "hangs", ("ours-1", 1)) is not None
        assert now() == begun
        await asking
        assert drivers.times("hangs") == [5]

    virtual_time.run(run())
