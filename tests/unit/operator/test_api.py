"""The calls to the API server as they go over the wire, to an HTTP server that records them."""

import asyncio
import json
import tracemalloc
from collections.abc import AsyncIterator, Awaitable, Callable
from contextlib import asynccontextmanager
from typing import Any

import pytest
from aiohttp import web
from kubernetes.aio.client import ApiClient, Configuration
from kubernetes.aio.config import ConfigException

from bagpipe_operator import watchable
from bagpipe_operator.api.objects import Json
from bagpipe_operator.cluster.client import ApiError, get_if_there
from bagpipe_operator.jobs.kueue.api import KubernetesKueueApi
from bagpipe_operator.settings import Settings

Handler = Callable[[web.Request], Awaitable[web.StreamResponse]]
Call = tuple[str, str, str | None, Any]

JOBS = "/apis/sim.bagpipe.io/v1alpha1"


class Recorder:
    """Answers in turn with (status, body) and keeps what it was asked; the last answer stays."""

    def __init__(self, *answers: tuple[int, object]) -> None:
        self.answers = list(answers)
        self.calls: list[Call] = []

    async def answer(self, request: web.Request) -> web.Response:
        text = await request.text()
        body = json.loads(text) if text else None
        kind = request.headers.get("Content-Type") if body else None
        self.calls.append((request.method, request.path_qs, kind, body))
        status, answer = self.answers[0] if len(self.answers) == 1 else self.answers.pop(0)
        shown = answer if isinstance(answer, str) else json.dumps(answer)
        return web.Response(status=status, text=shown)


@asynccontextmanager
async def server(
    handler: Handler, deadline: float = 60.0, writes_for: Callable[[], float] = lambda: 60.0
) -> AsyncIterator[KubernetesKueueApi]:
    app = web.Application()
    app.router.add_route("*", "/{tail:.*}", handler)
    runner = web.AppRunner(app)
    await runner.setup()
    await web.TCPSite(runner, "127.0.0.1", 0).start()
    configuration = Configuration(host=f"http://127.0.0.1:{runner.addresses[0][1]}")
    async with ApiClient(configuration=configuration) as client:
        yield KubernetesKueueApi(client, deadline, writes_for=writes_for)
    await runner.cleanup()


async def test_the_calls() -> None:
    recorder = Recorder((200, {"kind": "Any"}))
    manifest = {"metadata": {"name": "p", "namespace": "lanes"}, "spec": {"unknownField": [1]}}
    patch = {"metadata": {"resourceVersion": "7"}, "status": {"phase": "Pending"}}
    async with server(recorder.answer) as api:
        assert await api.create("pods", manifest) == {"kind": "Any"}
        await api.get("configmaps", "lanes", "x-1")
        assert await api.delete_pod("lanes", "p", "uid-of-p") is True
        assert await api.delete_pod("lanes", "p", "uid-of-p", 10) is True
        await api.get_job("lanes", "x")
        await api.patch_status("lanes", "x", patch)
        await api.try_create("pods", manifest)
        assert await api.events_of("lanes", "uid-of-p") == []
    options = {"apiVersion": "v1", "kind": "DeleteOptions", "preconditions": {"uid": "uid-of-p"}}
    plain, merge = "application/json", "application/merge-patch+json"
    soon = "timeout=59500ms"
    pod = f"/api/v1/namespaces/lanes/pods/p?{soon}"
    assert recorder.calls == [
        ("POST", f"/api/v1/namespaces/lanes/pods?{soon}", plain, manifest),
        ("GET", "/api/v1/namespaces/lanes/configmaps/x-1", None, None),
        ("DELETE", pod, plain, options),
        ("DELETE", pod, plain, options | {"gracePeriodSeconds": 10}),
        ("GET", f"{JOBS}/namespaces/lanes/simulationjobs/x", None, None),
        ("PATCH", f"{JOBS}/namespaces/lanes/simulationjobs/x/status?{soon}", merge, patch),
        ("POST", "/api/v1/namespaces/lanes/pods?dryRun=All&timeout=59500ms", plain, manifest),
        (
            "GET",
            "/api/v1/namespaces/lanes/events?fieldSelector=involvedObject.uid%3Duid-of-p&limit=5",
            None,
            None,
        ),
    ]


async def test_no_page_is_asked_for_beyond_what_is_wanted() -> None:
    page = {"items": [{"kind": "A"}, {"kind": "B"}], "metadata": {"continue": "x"}}
    recorder = Recorder(*[(200, page)] * 3)
    async with server(recorder.answer) as api:
        found = await api.list_jobs("lanes", "a=b", 3)
    assert [each["kind"] for each in found] == ["A", "B", "A"]
    assert len(recorder.calls) == 2


def hostile_events(size: int) -> Handler:
    """A server with Events about a pod without end, each with a message of that size."""
    event = {"metadata": {"name": "e"}, "involvedObject": {"uid": "p"}, "reason": "Failed"}
    text = json.dumps(event | {"message": "y" * size})

    async def answer(request: web.Request) -> web.Response:
        items = ",".join([text] * int(request.query["limit"]))
        return web.Response(text=f'{{"metadata":{{"continue":"x"}},"items":[{items}]}}')

    return answer


async def test_a_hundred_large_events_about_a_pod_take_the_memory_of_a_few() -> None:
    """Who has Kubernetes' role `edit` may write them: 100 of 1.4 MB took 400 MiB at once."""
    size = 200_000
    async with server(hostile_events(size)) as api:
        tracemalloc.start()
        try:
            found = await api.events_of("lanes", "p")
            peak = tracemalloc.get_traced_memory()[1]
        finally:
            tracemalloc.stop()
    assert len(found) == 100
    assert {len(json.dumps(event)) for event in found} < {*range(1_500)}
    # Of a page the server's text and its bytes, and here the bytes and the text, twice at most.
    assert peak < 50 * size


async def test_events_without_end_have_the_time_of_one_call() -> None:
    async def answer(_: web.Request) -> web.Response:
        return web.json_response({"metadata": {"continue": "x"}, "items": []})

    async with server(answer, deadline=0.3) as api:
        with pytest.raises(ApiError) as caught:
            await api.events_of("lanes", "p")
    assert caught.value.timed_out


async def test_the_calls_for_schedules() -> None:
    recorder = Recorder((200, {"items": [{"kind": "SimulationJob"}]}))
    manifest = {"metadata": {"name": "n-1", "namespace": "lanes"}, "spec": {"unknownField": [1]}}
    patch = {"metadata": {"resourceVersion": "7"}, "status": {"nextScheduleTime": None}}
    async with server(recorder.answer) as api:
        await api.create_job(manifest)
        found = await api.list_jobs("lanes", "sim.bagpipe.io/schedule=nightly")
        assert [each["kind"] for each in found] == ["SimulationJob"]
        await api.delete_job("lanes", "n-1", "uid-of-n-1")
        await api.get_schedule("lanes", "nightly")
        await api.patch_schedule_status("lanes", "nightly", patch)
    options = {
        "apiVersion": "v1",
        "kind": "DeleteOptions",
        "propagationPolicy": "Background",
        "preconditions": {"uid": "uid-of-n-1"},
    }
    jobs = f"{JOBS}/namespaces/lanes/simulationjobs"
    one = f"{JOBS}/namespaces/lanes/simulationschedules/nightly"
    plain, merge = "application/json", "application/merge-patch+json"
    selector = "labelSelector=sim.bagpipe.io/schedule%3Dnightly"
    assert recorder.calls == [
        ("POST", f"{jobs}?timeout=59500ms", plain, manifest),
        ("GET", f"{jobs}?{selector}&limit=20", None, None),
        ("DELETE", f"{jobs}/n-1?timeout=59500ms", plain, options),
        ("GET", one, None, None),
        ("PATCH", f"{one}/status?timeout=59500ms", merge, patch),
    ]


async def test_a_refusal_carries_the_server_s_reason_and_sentence() -> None:
    answer = {"kind": "Status", "reason": "AlreadyExists", "message": 'pods "p" already exists'}
    async with server(Recorder((409, answer)).answer) as api:
        with pytest.raises(ApiError) as caught:
            await api.get("pods", "lanes", "p")
    error = caught.value
    assert (error.status, error.reason) == (409, "AlreadyExists")
    assert error.message == 'pods "p" already exists'


async def test_a_refusal_that_quotes_a_megabyte_is_cut() -> None:
    """Kubernetes quotes a wrong value for each rule that it breaks; refusals are kept by job."""
    message = f'Pod "p" is invalid: spec.affinity: Invalid value: "{"_" * 900_000}": no label'
    answer = {"kind": "Status", "reason": "Invalid", "message": message}
    async with server(Recorder((422, answer)).answer) as api:
        with pytest.raises(ApiError) as caught:
            await api.get("pods", "lanes", "p")
    cut = caught.value.message
    assert len(cut) <= 4_200
    assert cut[:4_096] == message[:4_096]
    assert cut.endswith(f" [cut: {len(message) - 4_096} more characters]")


async def test_a_proxy_s_page_is_an_error_too() -> None:
    async with server(Recorder((502, "<html>Bad Gateway</html>")).answer) as api:
        with pytest.raises(ApiError) as caught:
            await api.get("pods", "lanes", "p")
    assert (caught.value.status, caught.value.message) == (502, "<html>Bad Gateway</html>")


GONE = {"kind": "Status", "reason": "NotFound", "message": 'pods "p" not found'}
# Of a proxy, and of an API server that serves no such resource, as while its CRD is replaced.
NOT_SERVED = (
    "404 page not found",
    GONE | {"message": "the server could not find the requested resource"},
    GONE | {"message": 'pods "another" not found'},
)


def conflict(why: str) -> Json:
    message = f'Operation cannot be fulfilled on Pod "p": {why}'
    return {"kind": "Status", "reason": "Conflict", "code": 409, "message": message}


# As Kubernetes 1.34 writes it before it deletes, and while it does.
NOT_THIS_ONE = (
    conflict(
        "the UID in the precondition (uid-of-p) does not match the UID in record (another). The "
        "object might have been deleted and then recreated"
    ),
    conflict(
        "StorageError: invalid object, Code: 4, Key: /registry/pods/lanes/p, AdditionalErrorMsg: "
        "Precondition failed: UID in precondition: uid-of-p, UID in object meta: another"
    ),
)
DENIED = (
    'admission webhook "pods.example" denied the request: a backup of this pod is running',
    'admission webhook "pods.example" denied the request: the UID in the precondition (uid-of-p)',
)


@pytest.mark.parametrize(
    ("status", "answer"), [(404, GONE), *((409, another) for another in NOT_THIS_ONE)]
)
async def test_deleting_what_is_gone_is_no_error_and_is_reported(status: int, answer: Json) -> None:
    async with server(Recorder((status, answer)).answer) as api:
        assert await api.delete_pod("lanes", "p", "uid-of-p") is False


@pytest.mark.parametrize(
    "answer",
    [
        *({"kind": "Status", "reason": "Conflict", "message": message} for message in DENIED),
        conflict("the object has been modified"),
        conflict("the UID in the precondition (uid-of-q) does not match the UID in record (p)"),
        {"kind": "Status"},
    ],
)
async def test_another_conflict_does_not_say_that_what_is_deleted_is_gone(answer: Json) -> None:
    """A pod that runs was forgotten where a webhook denied its deletion with that code."""
    async with server(Recorder((409, answer)).answer) as api:
        with pytest.raises(ApiError, match="409"):
            await api.delete_pod("lanes", "p", "uid-of-p")
        with pytest.raises(ApiError, match="409"):
            await api.delete_job("lanes", "p", "uid-of-p")


async def test_what_is_there_is_got_and_what_is_gone_is_none() -> None:
    async with server(Recorder((200, {"kind": "Pod"}), (404, GONE)).answer) as api:
        assert await get_if_there(api, "pods", "lanes", "p") == {"kind": "Pod"}
        assert await get_if_there(api, "pods", "lanes", "p") is None


@pytest.mark.parametrize("answer", NOT_SERVED)
async def test_what_is_not_served_is_not_gone(answer: str | Json) -> None:
    async with server(Recorder((404, answer), (404, answer)).answer) as api:
        with pytest.raises(ApiError, match="404"):
            await get_if_there(api, "pods", "lanes", "p")
        with pytest.raises(ApiError, match="404"):
            await api.delete_pod("lanes", "p", "uid-of-p")


async def test_a_server_that_does_not_answer_is_given_up_at_the_deadline() -> None:
    given_up = asyncio.Event()

    async def handler(_: web.Request) -> web.Response:
        await given_up.wait()
        return web.Response()

    async with server(handler, deadline=0.3) as api:
        with pytest.raises(ApiError) as caught:
            await api.get("pods", "lanes", "p")
        given_up.set()
    assert (caught.value.status, caught.value.reason) == (0, "Timeout")


@pytest.mark.parametrize(
    ("deadline", "writes_for", "dry_run", "create"),
    [
        (10.0, 5.25, "dryRun=All&timeout=9500ms", "timeout=4750ms"),
        (10.0, 60.0, "dryRun=All&timeout=9500ms", "timeout=9500ms"),
        # What is given less could not be made by an API server in good health.
        (1.4, 1.4, "dryRun=All", ""),
        (10.0, -1.0, "dryRun=All&timeout=9500ms", ""),
    ],
)
async def test_the_api_server_gives_up_a_webhook_before_we_give_up_the_api_server(
    deadline: float, writes_for: float, dry_run: str, create: str
) -> None:
    """Only its own answer names the webhook; and a write is cut when the fence closes."""
    recorder, manifest = Recorder((200, {})), {"metadata": {"name": "p", "namespace": "lanes"}}
    async with server(recorder.answer, deadline, lambda: writes_for) as api:
        await api.try_create("pods", manifest)
        await api.try_job(manifest)
        await api.create("pods", manifest)
        await api.create_job(manifest)
        await api.create_workload(manifest)
        await api.patch_status("lanes", "x", {})
        await api.delete_pod("lanes", "x", "uid-of-x")
        await api.delete_unchanged_job("lanes", "x", "uid-of-x", "7")
    queries = [call[1].partition("?")[2] for call in recorder.calls]
    assert queries == [dry_run, dry_run, *[create] * 6]


async def test_nobody_there() -> None:
    configuration = Configuration(host="http://127.0.0.1:1")
    async with ApiClient(configuration=configuration) as client:
        with pytest.raises(ApiError, match="Unreachable"):
            await KubernetesKueueApi(client, 1.0).get("pods", "lanes", "p")


MISSING = (404, {"kind": "Status", "reason": "NotFound", "message": "no such resource"})


async def test_the_crd_is_waited_for(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(watchable, "WATCHABLE_POLL_SECONDS", 0.01)
    recorder = Recorder(MISSING, MISSING, (200, {"items": []}))
    async with server(recorder.answer) as api:
        await watchable.wait_until_watchable(api, Settings(watch_namespaces=("lanes", "maps")))
    assert [call[1] for call in recorder.calls] == [
        *[f"{JOBS}/namespaces/lanes/simulationjobs?limit=1"] * 3,
        f"{JOBS}/namespaces/lanes/simulationschedules?limit=1",
        "/api/v1/namespaces/lanes/pods?limit=1",
        f"{JOBS}/namespaces/maps/simulationjobs?limit=1",
        f"{JOBS}/namespaces/maps/simulationschedules?limit=1",
        "/api/v1/namespaces/maps/pods?limit=1",
    ]


FORBIDDEN = (403, {"kind": "Status", "reason": "Forbidden", "message": "no RoleBinding"})


async def _without_rights_in_lanes(request: web.Request) -> web.Response:
    if "/namespaces/lanes/" in request.path:
        return web.json_response(FORBIDDEN[1], status=FORBIDDEN[0])
    return web.json_response({"items": []})


async def test_a_namespace_without_rights_holds_up_no_other(
    monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    """Its administrator has taken the RoleBinding away, or it was deleted."""
    monkeypatch.setattr(watchable, "WATCHABLE_SECONDS", 0.05)
    monkeypatch.setattr(watchable, "WATCHABLE_POLL_SECONDS", 0.01)
    async with server(_without_rights_in_lanes) as api:
        settings = Settings(watch_namespaces=("lanes", "maps"))
        assert await watchable.wait_until_watchable(api, settings) == {"lanes"}
    assert "namespace lanes can't be watched: 403 Forbidden: no RoleBinding" in caplog.text


async def test_without_rights_anywhere_the_operator_ends(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(watchable, "WATCHABLE_SECONDS", 0.05)
    monkeypatch.setattr(watchable, "WATCHABLE_POLL_SECONDS", 0.01)
    async with server(Recorder(FORBIDDEN).answer) as api:
        with pytest.raises(ApiError, match="no RoleBinding"):
            await watchable.wait_until_watchable(api, Settings(watch_namespaces=("lanes", "maps")))


async def test_kueue_is_waited_for_where_it_is_wanted() -> None:
    recorder = Recorder((200, {"items": []}))
    async with server(recorder.answer) as api:
        await watchable.wait_until_watchable(api, Settings(watch_namespaces=("lanes",), kueue=True))
    assert [call[1] for call in recorder.calls[3:]] == [
        "/apis/kueue.x-k8s.io/v1beta2/namespaces/lanes/workloads?limit=1"
    ]


@pytest.mark.parametrize(
    "name", ["../../../../api/v1/secrets", "a/b", "..", "x?watch=true", "A", ""]
)
async def test_what_a_tenant_names_is_no_path(name: str) -> None:
    recorder = Recorder((200, {"value": 1}))
    async with server(recorder.answer) as api:
        with pytest.raises(ApiError, match="404"):
            await api.get_priority_class("scheduling.k8s.io", name)
        with pytest.raises(ApiError, match="404"):
            await api.get_resource_flavor(name)
        assert await api.get_priority_class("scheduling.k8s.io", "high.v2-a") == {"value": 1}
    assert [call[1] for call in recorder.calls] == [
        "/apis/scheduling.k8s.io/v1/priorityclasses/high.v2-a"
    ]


async def test_the_wait_for_the_crd_has_an_end(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(watchable, "WATCHABLE_SECONDS", 0.05)
    monkeypatch.setattr(watchable, "WATCHABLE_POLL_SECONDS", 0.01)
    async with server(Recorder(MISSING).answer) as api:
        with pytest.raises(ApiError, match="no such resource"):
            await watchable.wait_until_watchable(api, Settings())


async def test_uids_come_by_pages_without_specs() -> None:
    asked: list[tuple[str, str | None, str]] = []

    async def answer(request: web.Request) -> web.Response:
        token = request.query.get("continue")
        asked.append((request.path, token, request.headers["Accept"].split(";")[1]))
        number = len(asked)
        meta = {"continue": "a+b/c=="} if number == 1 else {}
        item = {"metadata": {"uid": f"uid-{number}"}}
        return web.json_response({"metadata": meta, "items": [item]})

    async with server(answer) as api:
        assert await api.job_uids(None) == {"uid-1", "uid-2"}
        assert await api.job_uids("lanes") == {"uid-3"}
        assert await api.schedule_uids("lanes") == {"uid-4"}
    everywhere, lanes = f"{JOBS}/simulationjobs", f"{JOBS}/namespaces/lanes/simulationjobs"
    brief = "as=PartialObjectMetadataList"
    assert asked == [
        (everywhere, None, brief), (everywhere, "a+b/c==", brief), (lanes, None, brief),
        (f"{JOBS}/namespaces/lanes/simulationschedules", None, brief),
    ]  # fmt: skip


async def test_an_answer_that_is_no_json_is_a_fault_of_the_call() -> None:
    recorder = Recorder((200, "<html>hello</html>"))
    async with server(recorder.answer) as api:
        with pytest.raises(ApiError, match=r"Unreadable.*hello"):
            await api.get_job("lanes", "x")


@pytest.mark.parametrize("answer", [[], "text", 7, None])
async def test_an_answer_that_is_no_object_is_a_fault_of_the_call(answer: object) -> None:
    async with server(Recorder((200, json.dumps(answer))).answer) as api:
        with pytest.raises(ApiError, match="Unreadable"):
            await api.job_uids("lanes")


@pytest.mark.parametrize(
    "fault", [ConfigException("Token file exists but empty."), FileNotFoundError("token")]
)
async def test_a_token_that_can_t_be_read_is_a_fault_of_the_call(fault: Exception) -> None:
    """The kubelet writes a new one every hour, and the client reads it before a call."""

    async def renew(_: object) -> None:
        raise fault

    configuration: Any = Configuration(host="http://127.0.0.1:1")
    configuration.refresh_api_key_hook = renew
    configuration.api_key["BearerToken"] = "of before"
    async with ApiClient(configuration=configuration) as client:
        with pytest.raises(ApiError, match=str(fault)) as caught:
            await KubernetesKueueApi(client, 60.0).get_job("lanes", "x")
    assert (caught.value.status, caught.value.reason) == (0, "Unreachable")
