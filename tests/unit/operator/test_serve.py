"""/metrics, /livez and /readyz, over real HTTP; the clock is asyncio's own, made fast."""

import asyncio

import aiohttp
import pytest
from aiohttp import web

from bagpipe_operator.jobs.metrics import JobMetrics
from bagpipe_operator.jobs.sweep import Sweeper
from bagpipe_operator.jobs.view import View
from bagpipe_operator.runtime import serve
from bagpipe_operator.runtime.queue import WorkQueue
from tests.unit.operator.builders import make_job


async def ask(app: web.Application, path: str) -> tuple[int, str]:
    runner = await serve.start(app, "127.0.0.1", 0)
    port = runner.addresses[0][1]
    url = f"http://127.0.0.1:{port}{path}"
    async with aiohttp.ClientSession() as session, session.get(url) as response:
        answer = response.status, await response.text()
    await runner.cleanup()
    return answer


async def test_not_ready_before_the_watches_and_alive_all_the_same() -> None:
    view, queue = View(), WorkQueue()
    health = serve.Health(Sweeper(view, queue, 2.0))
    app = serve.application(health, JobMetrics(view, queue))
    assert await ask(app, "/livez") == (200, "ok\n")
    app = serve.application(health, JobMetrics(view, queue))
    status, text = await ask(app, "/readyz")
    assert (status, text) == (503, "the watches have not started: is the CRD installed?\n")


async def test_a_replica_that_can_not_stand_by_is_alive_and_not_ready() -> None:
    view, queue = View(), WorkQueue()
    sweeper = Sweeper(view, queue, 2.0)
    sweeper.last_sweep = asyncio.get_running_loop().time()
    health = serve.Health(sweeper, watching=True, lease_trouble=lambda: "the Lease is denied")
    assert (health.dead(), health.unready()) == ("", "the Lease is denied")


@pytest.mark.parametrize(("leads", "value"), [(True, "1.0"), (False, "0.0")])
async def test_metrics_say_who_leads(leads: bool, value: str) -> None:
    view, queue = View(), WorkQueue()
    metrics = JobMetrics(view, queue, leads=lambda: leads)
    app = serve.application(serve.Health(Sweeper(view, queue, 2.0)), metrics)
    _, text = await ask(app, "/metrics")
    assert f"bagpipe_leader {value}" in text


@pytest.mark.looptime
async def test_a_sweeper_that_stops_is_reported() -> None:
    sweeper = Sweeper(View(), WorkQueue(), 2.0)
    health = serve.Health(sweeper, watching=True)
    sweeping = asyncio.create_task(sweeper.run())
    await asyncio.sleep(101)
    assert (health.dead(), health.unready()) == ("", "")
    sweeping.cancel()
    await asyncio.sleep(30)
    assert health.dead() == "no sweep for 31 s"


async def test_metrics_count_jobs_by_phase_without_naming_them() -> None:
    view, queue = View(), WorkQueue()
    view.put_job(make_job("alpha").with_status(phase="Running").view())
    view.put_job(make_job("beta").with_status(phase="Running").view())
    view.put_job(make_job("gamma").view())
    queue.add("uid-of-alpha")
    app = serve.application(serve.Health(Sweeper(view, queue, 2.0)), JobMetrics(view, queue))
    status, text = await ask(app, "/metrics")
    assert status == 200
    assert 'bagpipe_jobs{phase="Running"} 2.0' in text
    assert 'bagpipe_jobs{phase="Pending"} 1.0' in text
    assert "bagpipe_queue_depth 1.0" in text
    assert "process_resident_memory_bytes" in text
    assert "alpha" not in text


def test_the_sweep_visits_what_has_not_ended() -> None:
    ended = {"type": "Complete", "status": "True"}
    view, queue = View(), WorkQueue(lambda: 0.0)
    view.put_job(make_job("a").view())
    view.put_job(make_job("b").with_status(conditions=[ended]).view())
    view.put_job(make_job("c").deleting().view())
    assert Sweeper(view, queue, 2.0).sweep() == 1
    assert len(queue) == 1


def test_a_new_leader_visits_every_job() -> None:
    view, queue = View(), WorkQueue(lambda: 0.0)
    view.put_job(make_job("a").view())
    view.put_job(
        make_job("b").with_status(conditions=[{"type": "Complete", "status": "True"}]).view()
    )
    Sweeper(view, queue, 2.0).sweep_all()
    assert len(queue) == 2
