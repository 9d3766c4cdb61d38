"""/metrics, /livez and /readyz. kopf's own /healthz would stay 200 while nothing moves."""

import asyncio
from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

from aiohttp import web
from prometheus_client import CONTENT_TYPE_LATEST, generate_latest

from bagpipe_operator.runtime.metrics import Metrics, of_the_process

# This many missed sweeps mean that the event loop or the sweeper is stuck.
MISSED_SWEEPS = 15


class Pulse(Protocol):
    """What is done again and again as long as the event loop lives."""

    period_seconds: float
    last_sweep: float  # by the event loop's clock


@dataclass
class Health:
    """What the probes are answered from."""

    sweeper: Pulse
    watching: bool = False  # kopf has started its watches
    lease_trouble: Callable[[], str] = lambda: ""  # why it can't even wait for its turn to lead

    def dead(self) -> str:
        """Why the process should be restarted; empty when it should not."""
        age = asyncio.get_running_loop().time() - self.sweeper.last_sweep
        if self.watching and age > MISSED_SWEEPS * self.sweeper.period_seconds:
            return f"no sweep for {age:.0f} s"
        return ""

    def unready(self) -> str:
        """Why the operator neither works nor stands by for the leader; empty when it does."""
        if not self.watching:
            return "the watches have not started: is the CRD installed?"
        return self.dead() or self.lease_trouble()


def application(health: Health, metrics: Metrics) -> web.Application:
    """The HTTP application."""

    def answer(problem: str) -> web.Response:
        return web.Response(status=503 if problem else 200, text=f"{problem or 'ok'}\n")

    async def livez(_: web.Request) -> web.Response:
        return answer(health.dead())

    async def readyz(_: web.Request) -> web.Response:
        return answer(health.unready())

    async def scrape(_: web.Request) -> web.Response:
        body = generate_latest(metrics.registry)
        body += await asyncio.to_thread(of_the_process)
        return web.Response(body=body, headers={"Content-Type": CONTENT_TYPE_LATEST})

    app = web.Application()
    app.router.add_get("/livez", livez)
    app.router.add_get("/readyz", readyz)
    app.router.add_get("/metrics", scrape)
    return app


async def start(app: web.Application, host: str, port: int) -> web.AppRunner:
    """Serves until the runner is cleaned up."""
    runner = web.AppRunner(app, access_log=None)
    await runner.setup()
    await web.TCPSite(runner, host, port).start()
    return runner
