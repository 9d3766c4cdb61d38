"""The driver's account: bounded, checked, and asked for with a deadline, over real HTTP."""

import asyncio
from collections.abc import AsyncIterator, Awaitable, Callable
from contextlib import asynccontextmanager
from typing import Any

import aiohttp
import pytest
from aiohttp import web

from bagpipe_operator.jobs.driver.progress import (
    LEAST_INTERVAL_SECONDS,
    Progress,
    ProgressReader,
    parse,
)
from tests.unit.operator.builders import account

WHOSE = ("uid", 1)

Handler = Callable[[web.Request], Awaitable[web.StreamResponse]]


def test_what_is_written_into_the_status() -> None:
    progress = parse(
        account(
            cases={"planned": 4, "running": 2, "passed": 1, "quarantined": 2},
            failures=[{"case": "x-1", "reason": "Lost", "message": "m"}],
        )
    )
    assert progress is not None
    assert progress.as_status() == {
        "cases": {
            "planned": 4,
            "running": 2,
            "passed": 1,
            "failed": 0,
            "invalid": 0,
            "errored": 0,
            "crashed": 0,
            "lost": 0,
            "regressed": 0,
            "quarantined": 2,
            "discarded": 0,
        },
        "ledger": {"sent": 400, "received": 400, "dropped": 0, "leadIn": 8},
        "results": "pvc://results/lane/x",
        "failures": [{"case": "x-1", "reason": "Lost", "message": "m"}],
        "comparisons": [],
    }


def test_long_accounts_are_cut() -> None:
    failures = [{"case": f"c{n}", "reason": "R", "message": "m" * 9999} for n in range(9)]
    progress = parse(account(message="m" * 9999, failures=failures))
    assert progress is not None
    assert [f.case for f in progress.failures] == ["c4", "c5", "c6", "c7", "c8"]
    assert [len(f.message) for f in progress.failures] == [1000] * 5
    assert len(progress.message) == 1000


@pytest.mark.parametrize(
    "text",
    [
        "",
        "Killed",
        "[]",
        '{"phase": "Dancing"}',
        account(cases={"planned": -1}),
        account(cases={"planned": "many"}),
        account(failures="none"),
        account()[:-5],
    ],
)
def test_what_can_not_be_read_is_none(text: str) -> None:
    assert parse(text) is None


@asynccontextmanager
async def driver(handler: Handler, seconds: float = 30.0) -> AsyncIterator[ProgressReader]:
    app = web.Application()
    app.router.add_get("/progress", handler)
    runner = web.AppRunner(app)
    await runner.setup()
    site = web.TCPSite(runner, "127.0.0.1", 0)
    await site.start()
    port = runner.addresses[0][1]
    async with aiohttp.ClientSession() as session:
        yield ProgressReader(session, deadline_seconds=seconds, port=port)
    await runner.cleanup()


async def test_an_answer_is_read_and_remembered(monkeypatch: pytest.MonkeyPatch) -> None:
    # A busy machine may take longer than that between two questions.
    monkeypatch.setattr("bagpipe_operator.jobs.driver.progress.LEAST_INTERVAL_SECONDS", 600.0)
    asked = 0

    async def handler(_: web.Request) -> web.Response:
        nonlocal asked
        asked += 1
        return web.Response(text=account())

    async with driver(handler) as reader:
        first = await reader.read("uid", "127.0.0.1", WHOSE)
        second = await reader.read("uid", "127.0.0.1", WHOSE)
    assert first is second
    assert first is not None
    assert (first.cases.planned, asked) == (4, 1)
    assert LEAST_INTERVAL_SECONDS < 2.0  # shorter than the sweep, or every other one is wasted


@pytest.mark.parametrize(
    ("fields", "believed"),
    [
        ({"uid": "job", "attempt": 2}, True),
        ({}, True),  # an image of an earlier release
        ({"uid": "another", "attempt": 2}, False),
        ({"uid": "job", "attempt": 1}, False),
    ],
)
async def test_the_answer_of_another_s_driver_is_silence(
    fields: dict[str, Any], believed: bool
) -> None:
    """A pod's address goes to another when the pod is gone, and the watch may be behind."""

    async def handler(_: web.Request) -> web.Response:
        return web.Response(text=account(**fields))

    counted: list[bool] = []
    async with driver(handler) as reader:
        reader.counted = counted.append
        progress = await reader.read("key", "127.0.0.1", ("job", 2))
        assert (progress is not None) is believed
        assert (reader.silent_seconds("key") == 0.0) is believed
    assert counted == [believed]


async def test_a_driver_that_does_not_answer_in_time_is_silent() -> None:
    given_up = asyncio.Event()

    async def handler(_: web.Request) -> web.Response:
        await given_up.wait()
        return web.Response(text=account())

    async with driver(handler, 0.3) as reader:
        started = asyncio.get_running_loop().time()
        assert await reader.read("uid", "127.0.0.1", WHOSE) is None
        given_up.set()
        assert asyncio.get_running_loop().time() - started > 0.2
        assert reader.silent_seconds("uid") >= 0.2
        reader.forget("uid")
        assert reader.silent_seconds("uid") == 0.0


async def test_an_endless_answer_is_refused() -> None:
    async def handler(request: web.Request) -> web.StreamResponse:
        response = web.StreamResponse()
        await response.prepare(request)
        for _ in range(100):
            await response.write(b" " * 16384)
        return response

    async with driver(handler) as reader:
        assert await reader.read("uid", "127.0.0.1", WHOSE) is None


@pytest.mark.parametrize("status", [302, 404, 500])
async def test_other_answers_are_none(status: int) -> None:
    async def handler(_: web.Request) -> web.Response:
        return web.Response(status=status, text=account(), headers={"Location": "/progress"})

    async with driver(handler) as reader:
        assert await reader.read("uid", "127.0.0.1", WHOSE) is None


async def test_nobody_there_is_none() -> None:
    async with aiohttp.ClientSession() as session:
        reader = ProgressReader(session, deadline_seconds=1, port=1)
        assert await reader.read("uid", "127.0.0.1", WHOSE) is None


def test_a_driver_of_the_earlier_release_is_understood() -> None:
    progress = parse(account(cases={"planned": 4, "retried": 3}))
    assert progress is not None
    assert progress.cases.discarded == 3
    assert progress.as_status()["cases"]["discarded"] == 3


async def test_what_is_remembered_of_the_job_before_is_no_account_of_the_next() -> None:
    """A driver of a pool takes the next job within the time in which it is not asked again."""
    words = {"body": account("Complete", uid="one", attempt=1, ended=True, verdict="Passed")}

    class Reader(ProgressReader):
        async def _ask(self, ip: str) -> Progress | None:  # noqa: ARG002  one driver
            return parse(words["body"]) if words["body"] else None

    async with aiohttp.ClientSession() as session:
        reader = Reader(session, 1.0)
        first = await reader.read("pod", "10.0.0.5", ("one", 1))
        assert first is not None
        assert (first.uid, first.verdict) == ("one", "Passed")
        assert await reader.read("pod", "10.0.0.5", ("two", 1)) is None
        words["body"] = ""
        assert await reader.read("pod", "10.0.0.5", ("two", 1)) is None
        assert await reader.read("pod", "10.0.0.5", ("two", 2)) is None
