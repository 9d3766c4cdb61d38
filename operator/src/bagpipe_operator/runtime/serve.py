"""/metrics, /livez and /readyz. kopf's own /healthz would stay 200 while nothing moves.

Whoever reaches the port may ask without end, or not at all: neither takes memory or time.
"""

import asyncio
from collections.abc import Awaitable, Callable
from dataclasses import dataclass
from typing import Protocol

from aiohttp import web
from prometheus_client import CONTENT_TYPE_LATEST, generate_latest

from bagpipe_operator.runtime.metrics import Metrics, of_the_process

# This many missed sweeps mean that the event loop or the sweeper is stuck.
MISSED_SWEEPS = 15
# Two Prometheuses and a kubelet have a handful; each takes ten kilobytes and more.
MOST_CONNECTIONS = 128
# Without a request for so long a connection is closed: who scrapes more seldom opens another.
IDLE_SECONDS = 60.0
SCRAPE_SECONDS = 1.0

Answers = Callable[[web.BaseRequest], Awaitable[web.Response]]


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
    list_trouble: Callable[[], str] = lambda: ""  # why it sees no job anywhere

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
        return self.dead() or self.lease_trouble() or self.list_trouble()


class _Scrapes:
    """The metrics as text, made once in SCRAPE_SECONDS, however many ask: each takes milliseconds
    of the loop's time, and of that of thousands of jobs."""

    def __init__(self, metrics: Metrics) -> None:
        self._metrics = metrics
        self._lock = asyncio.Lock()
        self._made_at = float("-inf")
        self._text = b""

    async def text(self) -> bytes:
        """As it is, or was a moment ago."""
        async with self._lock:
            now = asyncio.get_running_loop().time()
            if now - self._made_at >= SCRAPE_SECONDS:
                text = generate_latest(self._metrics.registry)
                self._text = text + await asyncio.to_thread(of_the_process)
                self._made_at = now
            return self._text


def answers(health: Health, metrics: Metrics) -> Answers:
    """What each request is answered with."""
    scrapes = _Scrapes(metrics)

    def judged(problem: str) -> web.Response:
        return web.Response(status=503 if problem else 200, text=f"{problem or 'ok'}\n")

    async def answer(request: web.BaseRequest) -> web.Response:
        if request.method not in {"GET", "HEAD"}:
            return web.Response(status=405, headers={"Allow": "GET, HEAD"})
        match request.path:
            case "/livez":
                return judged(health.dead())
            case "/readyz":
                return judged(health.unready())
            case "/metrics":
                headers = {"Content-Type": CONTENT_TYPE_LATEST}
                return web.Response(body=await scrapes.text(), headers=headers)
            case _:
                return web.Response(status=404, text="here are /livez, /readyz and /metrics\n")

    return answer


class _Server(web.Server):
    """Where one connection too many comes, that goes which came first: anybody may open some, and a
    probe's is answered at once."""

    def __init__(self, answer: Answers) -> None:
        super().__init__(answer, access_log=None, keepalive_timeout=IDLE_SECONDS)
        self._open: dict[web.RequestHandler, None] = {}

    def connection_made(self, handler: web.RequestHandler, transport: asyncio.Transport) -> None:
        super().connection_made(handler, transport)
        self._open[handler] = None
        if len(self._open) > MOST_CONNECTIONS:
            first = next(iter(self._open))
            del self._open[first]
            first.force_close()

    def connection_lost(
        self, handler: web.RequestHandler, exc: BaseException | None = None
    ) -> None:
        self._open.pop(handler, None)
        super().connection_lost(handler, exc)


async def start(answer: Answers, host: str, port: int) -> web.ServerRunner:
    """Serves until the runner is cleaned up."""
    runner = web.ServerRunner(_Server(answer))
    await runner.setup()
    await web.TCPSite(runner, host, port).start()
    return runner
