"""/metrics, /livez and /readyz, over real HTTP; the clock is asyncio's own, made fast."""

import asyncio
import time
from collections.abc import Iterator

import aiohttp
import pytest
from prometheus_client.core import Metric
from prometheus_client.registry import Collector

from bagpipe_operator.jobs.metrics import JobMetrics
from bagpipe_operator.jobs.sweep import Sweeper
from bagpipe_operator.jobs.view import View
from bagpipe_operator.runtime import serve
from bagpipe_operator.runtime.queue import WorkQueue
from tests.unit.operator.builders import make_job


async def ask(app: serve.Answers, path: str) -> tuple[int, str]:
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
    app = serve.answers(health, JobMetrics(view, queue))
    assert await ask(app, "/livez") == (200, "ok\n")
    app = serve.answers(health, JobMetrics(view, queue))
    status, text = await ask(app, "/readyz")
    assert (status, text) == (503, "the watches have not started: is the CRD installed?\n")


async def test_a_replica_that_can_not_stand_by_is_alive_and_not_ready() -> None:
    view, queue = View(), WorkQueue()
    sweeper = Sweeper(view, queue, 2.0)
    sweeper.last_sweep = asyncio.get_running_loop().time()
    health = serve.Health(sweeper, watching=True, lease_trouble=lambda: "the Lease is denied")
    assert (health.dead(), health.unready()) == ("", "the Lease is denied")


async def test_an_operator_that_can_list_no_job_anywhere_is_alive_and_not_ready() -> None:
    view, queue = View(), WorkQueue()
    sweeper = Sweeper(view, queue, 2.0)
    sweeper.last_sweep = asyncio.get_running_loop().time()
    health = serve.Health(sweeper, watching=True, list_trouble=lambda: "no list is answered")
    assert (health.dead(), health.unready()) == ("", "no list is answered")


@pytest.mark.parametrize(("leads", "value"), [(True, "1.0"), (False, "0.0")])
async def test_metrics_say_who_leads(leads: bool, value: str) -> None:
    view, queue = View(), WorkQueue()
    metrics = JobMetrics(view, queue, leads=lambda: leads)
    app = serve.answers(serve.Health(Sweeper(view, queue, 2.0)), metrics)
    _, text = await ask(app, "/metrics")
    assert f"bagpipe_leader {value}" in text


async def opened(port: int) -> tuple[asyncio.StreamReader, asyncio.StreamWriter]:
    """A connection that begins a request and never ends it."""
    reader, writer = await asyncio.open_connection("127.0.0.1", port)
    writer.write(b"GET /livez HTTP/1.1\r\nX: ")
    await writer.drain()
    return reader, writer


async def test_who_opens_connections_without_end_takes_no_memory_and_holds_up_no_probe() -> None:
    view, queue = View(), WorkQueue()
    app = serve.answers(serve.Health(Sweeper(view, queue, 2.0)), JobMetrics(view, queue))
    runner = await serve.start(app, "127.0.0.1", 0)
    port = runner.addresses[0][1]
    strangers = [await opened(port) for _ in range(3 * serve.MOST_CONNECTIONS)]
    async with asyncio.timeout(60), aiohttp.ClientSession() as session:
        async with session.get(f"http://127.0.0.1:{port}/livez") as response:
            assert (response.status, await response.text()) == (200, "ok\n")
        # Those that came first were closed, and the last ones are there.
        gone = strangers[: 2 * serve.MOST_CONNECTIONS]
        assert {await reader.read() for reader, _ in gone} == {b""}
    assert not strangers[-1][0].at_eof()
    for _, writer in strangers:
        writer.close()
    await runner.cleanup()


async def test_a_connection_without_a_request_is_closed(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(serve, "IDLE_SECONDS", 0.1)
    view, queue = View(), WorkQueue()
    app = serve.answers(serve.Health(Sweeper(view, queue, 2.0)), JobMetrics(view, queue))
    runner = await serve.start(app, "127.0.0.1", 0)
    reader, writer = await opened(runner.addresses[0][1])
    async with asyncio.timeout(60):
        assert await reader.read() == b""
    writer.close()
    await runner.cleanup()


async def test_who_scrapes_without_end_has_the_metrics_made_once_a_second() -> None:
    view, queue = View(), WorkQueue()
    view.put_job(make_job("alpha").view())
    metrics, made = JobMetrics(view, queue), list[None]()

    class Counted(Collector):
        def collect(self) -> Iterator[Metric]:
            made.append(None)
            return iter(())

    metrics.registry.register(Counted())
    made.clear()
    app = serve.answers(serve.Health(Sweeper(view, queue, 2.0)), metrics)
    runner = await serve.start(app, "127.0.0.1", 0)
    url, begun = f"http://127.0.0.1:{runner.addresses[0][1]}/metrics", time.monotonic()
    async with aiohttp.ClientSession() as session:

        async def text() -> str:
            async with session.get(url) as response:
                return await response.text()

        texts = await asyncio.gather(*(text() for _ in range(50)))
    seconds = time.monotonic() - begun
    assert all("bagpipe_jobs" in text for text in texts)
    assert len(made) <= 1 + seconds / serve.SCRAPE_SECONDS
    await runner.cleanup()


@pytest.mark.parametrize(("method", "path", "status"), [("POST", "/livez", 405), ("GET", "/", 404)])
async def test_other_requests_are_refused(method: str, path: str, status: int) -> None:
    view, queue = View(), WorkQueue()
    app = serve.answers(serve.Health(Sweeper(view, queue, 2.0)), JobMetrics(view, queue))
    runner = await serve.start(app, "127.0.0.1", 0)
    url = f"http://127.0.0.1:{runner.addresses[0][1]}{path}"
    async with aiohttp.ClientSession() as session, session.request(method, url) as response:
        assert response.status == status
    await runner.cleanup()


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
    app = serve.answers(serve.Health(Sweeper(view, queue, 2.0)), JobMetrics(view, queue))
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
    view.put_job(make_job("d").deleting().with_status(conditions=[ended]).view())
    assert Sweeper(view, queue, 2.0).sweep() == 2
    assert len(queue) == 2


def test_a_new_leader_visits_every_job() -> None:
    view, queue = View(), WorkQueue(lambda: 0.0)
    view.put_job(make_job("a").view())
    view.put_job(
        make_job("b").with_status(conditions=[{"type": "Complete", "status": "True"}]).view()
    )
    Sweeper(view, queue, 2.0).sweep_all()
    assert len(queue) == 2
