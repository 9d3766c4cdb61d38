"""kopf goes on with a namespace where its rights are taken away, and with the others meanwhile."""

import asyncio
import json
from collections import defaultdict
from collections.abc import Callable
from pathlib import Path

import kopf
import pytest
from aiohttp import web
from aiohttp.test_utils import TestServer

from bagpipe_operator.api import names
from bagpipe_operator.api.objects import Json
from bagpipe_operator.cluster.relists import Relists
from bagpipe_operator.jobs import watch
from bagpipe_operator.jobs.metrics import JobMetrics
from bagpipe_operator.jobs.view import View
from bagpipe_operator.runtime.queue import WorkQueue
from tests.unit.operator.builders import make_job
from tests.waiting import PATIENCE

# What kopf asks for before it watches anything.
RESOURCES = {
    "/api/v1": [("pods", "Pod"), ("events", "Event"), ("namespaces", "Namespace")],
    f"/apis/{names.API_VERSION}": [(names.PLURAL, names.KIND)],
    "/apis/apiextensions.k8s.io/v1": [("customresourcedefinitions", "CustomResourceDefinition")],
}


def described(path: str) -> Json | None:
    """The answer that names what there is; None for any other path."""
    if path == "/api":
        return {"versions": ["v1"]}
    if path == "/apis":
        groups = [each.split("/")[2:] for each in RESOURCES if each != "/api/v1"]
        return {
            "groups": [
                {"name": name, "preferredVersion": {"version": v}, "versions": [{"version": v}]}
                for name, v in groups
            ]
        }
    if path not in RESOURCES:
        return None
    kinds = [
        {
            "name": plural,
            "singularName": "",
            "kind": kind,
            "namespaced": plural in {"pods", "events", names.PLURAL},
            "verbs": ["list", "watch", "get"],
        }
        for plural, kind in RESOURCES[path]
    ]
    return {"resources": kinds}


class ApiServer:
    """Two namespaces, whose jobs are listed and watched; `taken`: the one without rights."""

    def __init__(self) -> None:
        self.taken = ""
        self.version = 10
        self.jobs: dict[str, list[Json]] = {"a": [], "b": []}
        self.refusals = 0
        self._watches = defaultdict[tuple[str, str], list[asyncio.Queue[Json | None]]](list)

    def add(self, namespace: str, name: str) -> None:
        self.version += 1
        job = make_job(name).object
        job["metadata"] |= {
            "namespace": namespace,
            "uid": f"{namespace}-{name}",
            "resourceVersion": str(self.version),
        }
        self.jobs[namespace].append(job)
        for lines in self._watches[names.PLURAL, namespace]:
            lines.put_nowait({"type": "ADDED", "object": job})

    def take_rights(self, namespace: str) -> None:
        """Nothing is answered there any more, and the watches that are open end."""
        self.taken = namespace
        self.end_watches(namespace)

    def end_watches(self, *namespaces: str) -> None:
        for (_, namespace), watches in self._watches.items():
            for lines in watches if namespace in namespaces else ():
                lines.put_nowait(None)

    def is_watched(self, *namespaces: str) -> bool:
        return all(self._watches[names.PLURAL, namespace] for namespace in namespaces)

    async def answer(self, request: web.Request) -> web.StreamResponse:
        if (description := described(request.path)) is not None:
            return web.json_response(description)
        namespace, kind = request.path.split("/")[-2:]
        if namespace == self.taken:
            self.refusals += 1
            return web.json_response({"kind": "Status", "code": 403}, status=403)
        of_jobs = kind == names.PLURAL
        if "watch" not in request.query:
            items = self.jobs[namespace] if of_jobs else []
            meta = {"resourceVersion": str(self.version)}
            return web.json_response({"metadata": meta, "items": items})
        response = web.StreamResponse()
        await response.prepare(request)
        lines: asyncio.Queue[Json | None] = asyncio.Queue()
        if of_jobs and int(request.query["resourceVersion"]) < self.version:
            gone: Json = {"kind": "Status", "code": 410, "reason": "Expired", "message": "old"}
            lines.put_nowait({"type": "ERROR", "object": gone})
            lines.put_nowait(None)
        self._watches[kind, namespace].append(lines)
        while (event := await lines.get()) is not None:
            await response.write(json.dumps(event).encode() + b"\n")
        return response


async def seen(what: Callable[[], bool]) -> None:
    async with asyncio.timeout(PATIENCE):
        while not what():  # noqa: ASYNC110 - kopf sets no event of ours
            await asyncio.sleep(0.01)


def kubeconfig_of(url: str) -> Json:
    return {
        "current-context": "c",
        "contexts": [{"name": "c", "context": {"cluster": "c", "user": "u"}}],
        "clusters": [{"name": "c", "cluster": {"server": url}}],
        "users": [{"name": "u", "user": {"token": "t"}}],
    }


@pytest.fixture
def kubeconfig(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Callable[[Json], object]:
    """Writes what kopf logs in by; it waits for less than it does elsewhere."""
    path = tmp_path / "kubeconfig"
    monkeypatch.setenv("KUBECONFIG", str(path))
    monkeypatch.setattr(watch, "SYSTEM_ERRORS_SECONDS", (0.01,))
    return lambda content: path.write_text(json.dumps(content))


async def test_the_watch_waits_for_rights_that_are_taken_and_the_others_go_on(
    kubeconfig: Callable[[Json], object],
) -> None:
    api, view, queue, relisted = ApiServer(), View(), WorkQueue(), list[None]()
    for namespace in ("a", "b"):
        api.add(namespace, "x")
    application = web.Application()
    application.router.add_get("/{tail:.*}", api.answer)
    async with TestServer(application) as server:
        kubeconfig(kubeconfig_of(str(server.make_url("/"))))
        watches = watch.Watch(view, queue, JobMetrics(view, queue))
        relists = Relists(lambda: relisted.append(None))
        handlers = watch.registry(watches, ("a", "b"), relists.answered)
        running = asyncio.create_task(
            kopf.operator(registry=handlers, namespaces=("a", "b"), standalone=True)
        )
        await seen(lambda: set(view.uids()) == {"a-x", "b-x"})
        await seen(lambda: api.is_watched("a", "b"))
        api.take_rights("b")
        await seen(lambda: api.refusals > 9)
        api.add("a", "y")
        await seen(lambda: "a-y" in view.uids())
        # Its jobs are looked for, once, however often the watch is refused.
        assert len(relisted) == 1
        api.jobs["b"].clear()
        api.add("b", "z")
        api.taken = ""
        await seen(lambda: "b-z" in view.uids())
        # What went meanwhile is in no event of the new watch, so that they are looked for again.
        assert (len(relisted), "b-x" in view.uids(), running.done()) == (2, True, False)
        running.cancel()
        await asyncio.gather(running, return_exceptions=True)
        api.end_watches("a", "b")
