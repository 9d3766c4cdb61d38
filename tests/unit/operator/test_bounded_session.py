"""kopf reads what a tenant has nested, over a real connection, and goes on with the next object."""

import asyncio
import json
from collections.abc import Awaitable, Callable
from typing import Any

import aiohttp
import kopf
import pytest
from aiohttp import web
from aiohttp.test_utils import TestServer
from kopf._cogs.clients.api import iter_jsonlines

from bagpipe_operator.api.nesting import is_deep
from bagpipe_operator.cluster.bounded_session import bounded_connection
from bagpipe_operator.cluster.relists import Relists
from tests.unit.operator.test_nesting import nested

DEEP = '{"spec": {"stack": {"parameters": {"/x": ' + nested(1_500) + "}}}}"
PLAIN = '{"spec": {"stack": {"image": "a"}}}'


def login(server: str, token: str = "t") -> kopf.ConnectionInfo:  # noqa: S107  no real one
    return kopf.ConnectionInfo(server=server, token=token)


async def answered(
    handler: Callable[[web.Request], Awaitable[web.StreamResponse]],
    path: str,
    read: Callable[[aiohttp.ClientResponse], Awaitable[Any]],
) -> Any:
    """What is read of an answer of a server on this machine."""
    application = web.Application()
    application.router.add_get("/jobs", handler)
    async with TestServer(application) as server:
        connection = bounded_connection(login(str(server.make_url("/"))))
        async with (
            connection.aiohttp_session as session,
            session.get(server.make_url(path)) as response,
        ):
            return await read(response)


def test_a_list_with_a_deep_object_is_read_and_the_others_are_whole() -> None:
    async def jobs(request: web.Request) -> web.Response:
        assert request.headers["Authorization"] == "Bearer t"
        text = f'{{"items": [{PLAIN}, {DEEP}, {PLAIN}]}}'
        return web.Response(text=text, content_type="application/json")

    with pytest.raises(RecursionError):
        json.loads(DEEP)
    found = asyncio.run(answered(jobs, "/jobs?limit=500", lambda response: response.json()))
    assert [is_deep(each["spec"]) for each in found["items"]] == [False, True, False]
    assert found["items"][0] == found["items"][2] == json.loads(PLAIN)


@pytest.mark.parametrize("size", [1, 7, 1_000, 1_000_000])
def test_a_watch_goes_on_after_a_deep_object_however_its_lines_are_cut(size: int) -> None:
    lines = "".join(f'{{"type": "ADDED", "object": {each}}}\n' for each in (PLAIN, DEEP, PLAIN))
    text = (lines + '{"type": "BOOKMARK"}').encode()

    async def jobs(request: web.Request) -> web.StreamResponse:
        response = web.StreamResponse()
        await response.prepare(request)
        for begin in range(0, len(text), size):
            await response.write(text[begin : begin + size])
        return response

    async def read(response: aiohttp.ClientResponse) -> list[Any]:
        return [json.loads(line) async for line in iter_jsonlines(response.content)]

    found = asyncio.run(answered(jobs, "/jobs?watch=true", read))
    assert [each["type"] for each in found] == ["ADDED", "ADDED", "ADDED", "BOOKMARK"]
    assert [is_deep(each["object"]["spec"]) for each in found[:3]] == [False, True, False]
    assert found[0]["object"] == found[2]["object"] == json.loads(PLAIN)


def test_a_login_that_was_refused_is_known_again_and_another_is_not() -> None:
    async def connections() -> list[bool]:
        first, again, other = (
            bounded_connection(login("https://a", token)) for token in ("t", "t", "u")
        )
        for each in (first, again, other):
            await each.aiohttp_session.close()
        return [first == again, first == other]

    assert asyncio.run(connections()) == [True, False]


def test_an_error_page_in_another_encoding_is_no_json_and_nothing_worse() -> None:
    async def page(_: web.Request) -> web.Response:
        return web.Response(status=502, body=b"<h1>d\xe9sol\xe9</h1>", content_type="text/html")

    with pytest.raises(json.JSONDecodeError):
        asyncio.run(answered(page, "/jobs", lambda response: response.json()))


LANES = "/apis/sim.bagpipe.io/v1alpha1/namespaces/lanes"


async def relists(*calls: tuple[str, int]) -> int:
    """How many lists of what was listed are noticed in calls with their statuses."""
    begun, statuses = list[None](), [status for _, status in calls]

    async def answer(_: web.Request) -> web.Response:
        return web.json_response({"items": []}, status=statuses.pop(0))

    application = web.Application()
    application.router.add_get("/{tail:.*}", answer)
    async with TestServer(application) as server:
        noticed = Relists(lambda: begun.append(None))
        connection = bounded_connection(login(str(server.make_url("/"))), noticed.answered)
        async with connection.aiohttp_session as session:
            for path, _ in calls:
                async with session.get(server.make_url(path)):
                    pass
    return len(begun)


@pytest.mark.parametrize("plural", ["simulationjobs", "simulationschedules"])
async def test_a_second_list_of_a_kind_is_noticed(plural: str) -> None:
    listed, more = f"{LANES}/{plural}?limit=20", f"{LANES}/{plural}?limit=20&continue=x"
    watched = f"{LANES}/{plural}?watch=true&resourceVersion=7"
    once = [(listed, 200), (more, 200), (watched, 200), (watched, 410)]
    assert await relists(*once) == 0
    assert await relists(*once, *once) == 1


async def test_rights_that_are_taken_away_are_noticed() -> None:
    """Once until they come back: what went meanwhile is in no event."""
    jobs, watched = (f"{LANES}/simulationjobs?{query}" for query in ("limit=20", "watch=true"))
    for refused in (jobs, watched):
        taken = [(jobs, 200), (refused, 403), (refused, 403), (jobs, 500), (refused, 403)]
        assert await relists(*taken) == 1
        # kopf goes on with the version that it has, as long as the API server knows it.
        assert await relists(*taken, (watched, 200), (watched, 403)) == 2
        assert await relists(*taken, (jobs, 200)) == 2


async def test_lists_of_other_kinds_and_places_and_refusals_are_not_noticed() -> None:
    jobs = f"{LANES}/simulationjobs?limit=20"
    others = [("/api/v1/pods?limit=20", 200), ("/apis/sim.bagpipe.io/v1alpha1", 200)] * 2
    elsewhere = [("/apis/sim.bagpipe.io/v1alpha1/namespaces/maps/simulationjobs?limit=20", 200)]
    # Without rights the list is asked for again and again.
    assert await relists((jobs, 403), (jobs, 403), (jobs, 200), *elsewhere, *others) == 0
