"""Ten thousand jobs as large as the API server stores them: what the operator takes for them.

No etcd holds 14 GB. So one such job is made for real, and its text is listed over and over, each
time under another name, by a server before the real one, which has all other calls.
"""

import asyncio
import json
import ssl
import tempfile
import time
from collections.abc import AsyncIterator, Iterator
from contextlib import asynccontextmanager
from dataclasses import dataclass, field
from pathlib import Path

import aiohttp
import yaml
from aiohttp import web

from tests.bench.operator_load import metric
from tests.bench.operator_world import Operator, plane_alone
from tests.integration.control_plane.client import JOBS, Client, Object, jobs
from tests.integration.control_plane.observe import a_job

LARGEST = 10_000
LISTED_SECONDS = 3600.0
NAMESPACE = "bench"
# As often as Prometheus would: a look at thousands of jobs is work for the operator, too.
LOOK_SECONDS = 15.0
# Three bytes of JSON for each, and sixty of Python's; more is refused by etcd.
EMPTY_LISTS = 470_000
_PASSED_ON = ("Accept", "Content-Type")
_PARTIAL = "as=PartialObjectMetadataList"


@dataclass(frozen=True)
class Largest:
    """What one start of the operator took."""

    job_bytes: int
    seconds: float
    processor_seconds: float
    peak_mib: float


async def largest(count: int) -> Largest:
    """Starts the operator before so many jobs, and waits until it has looked at each.

    Raises TimeoutError after LISTED_SECONDS.
    """
    with tempfile.TemporaryDirectory(prefix="bagpipe-bench-") as name, plane_alone() as plane:
        folder = Path(name)
        template = await _settled_job(plane.admin, plane.kubeconfig, folder)
        kubeconfig = folder / "kubeconfig"
        async with _before(plane.admin, Listing(template, count)) as url:
            _write_kubeconfig(kubeconfig, url)
            operator = Operator(kubeconfig, folder / "operator.log")
            begun = time.monotonic()
            operator.start()
            try:
                await _until_seen(operator, count, LOOK_SECONDS)
                took, used = time.monotonic() - begun, operator.processor_seconds()
                size = len(json.dumps(template, separators=(",", ":")))
                return Largest(size, took, used, operator.peak_mib())
            finally:
                operator.kill()


async def _settled_job(admin: Client, kubeconfig: Path, folder: Path) -> Object:
    """One suspended job of the largest size, whose status the operator has finished writing."""
    admin.create("/api/v1/namespaces", {"metadata": {"name": NAMESPACE}})
    job = a_job("largest")
    job["spec"] |= {"suspend": True}
    job["spec"]["stack"]["parameters"] = {"/x": [[] for _ in range(EMPTY_LISTS)]}
    admin.create(jobs(NAMESPACE), job)
    operator = Operator(kubeconfig, folder / "first.log")
    operator.start()
    try:
        await _until_seen(operator, 1)
    finally:
        operator.kill()
    return admin.get(jobs(NAMESPACE, "largest"))


async def _until_seen(operator: Operator, count: int, look_seconds: float = 0.5) -> None:
    """Waits until every job was listed and looked at, and says how far it is."""
    deadline, printed = time.monotonic() + LISTED_SECONDS, 0.0
    while True:
        _, text = await operator.ask("/metrics")
        known = sum(metric(text, 'bagpipe_jobs{phase="Suspended"}'))
        done = sum(metric(text, 'bagpipe_reconciles_total{result="done"}'))
        if known >= count and done >= count:
            return
        if not operator.server.alive or time.monotonic() > deadline:
            log = operator.log.read_text(errors="replace")[-2000:]
            raise TimeoutError(f"the operator knows {known:.0f} of {count} jobs: {log}")
        if known >= printed + count / 10:
            printed = known
            print(f"    {known:,.0f} jobs, {operator.peak_mib():.0f} MiB at most", flush=True)
        await asyncio.sleep(look_seconds)


@dataclass
class Listing:
    """The text of a job, listed `count` times."""

    template: Object
    count: int
    _spec: bytes = field(init=False)

    def __post_init__(self) -> None:
        self._spec = json.dumps(self.template["spec"], separators=(",", ":")).encode()

    def page(self, begin: int, limit: int, partial: bool) -> Iterator[bytes]:
        """The pieces of one page's text; `partial`: of the jobs' metadata alone."""
        end = min(self.count, begin + limit) if limit else self.count
        meta = {"resourceVersion": "1000000"} | ({"continue": str(end)} if end < self.count else {})
        head = {"apiVersion": self.template["apiVersion"], "kind": "SimulationJobList"}
        yield json.dumps(head | {"metadata": meta})[:-1].encode() + b',"items":['
        for number in range(begin, end):
            yield (b"," if number > begin else b"") + self._job(number, partial)
        yield b"]}"

    def _job(self, number: int, partial: bool) -> bytes:
        meta = self.template["metadata"] | {
            "name": f"largest-{number}",
            "uid": f"{number:08d}-0000-4000-8000-000000000000",
        }
        if partial:
            return json.dumps({"metadata": meta}).encode()
        rest = {key: value for key, value in self.template.items() if key != "spec"}
        text = json.dumps(rest | {"metadata": meta}, separators=(",", ":")).encode()
        return text[:-1] + b',"spec":' + self._spec + b"}"


@asynccontextmanager
async def _before(admin: Client, listing: Listing) -> AsyncIterator[str]:
    """The URL of a server that lists those jobs, and asks the real one whatever else."""
    context = ssl.create_default_context(cafile=str(admin.authority))
    context.load_cert_chain(str(admin.certificate), str(admin.key))
    connector = aiohttp.TCPConnector(ssl=context, limit=0)
    async with aiohttp.ClientSession(connector=connector, auto_decompress=False) as session:

        async def answer(request: web.Request) -> web.StreamResponse:
            if request.method == "GET" and request.path == f"{JOBS}/simulationjobs":
                return await _list(request, listing)
            return await _pass_on(request, session, admin.url)

        application = web.Application(client_max_size=1 << 24)
        application.router.add_route("*", "/{path:.*}", answer)
        runner = web.AppRunner(application, shutdown_timeout=1)
        await runner.setup()
        site = web.TCPSite(runner, "127.0.0.1", 0)
        await site.start()
        try:
            yield f"http://127.0.0.1:{runner.addresses[0][1]}"
        finally:
            await runner.cleanup()


async def _list(request: web.Request, listing: Listing) -> web.StreamResponse:
    response = web.StreamResponse(headers={"Content-Type": "application/json"})
    await response.prepare(request)
    if "watch" in request.query:
        await asyncio.sleep(LISTED_SECONDS)  # nothing ever changes
        return response
    begin, limit = (int(request.query.get(key) or 0) for key in ("continue", "limit"))
    for piece in listing.page(begin, limit, _PARTIAL in request.headers.get("Accept", "")):
        await response.write(piece)
    return response


async def _pass_on(
    request: web.Request, session: aiohttp.ClientSession, url: str
) -> web.StreamResponse:
    headers = {key: request.headers[key] for key in _PASSED_ON if key in request.headers}
    async with session.request(
        request.method, url + request.path_qs, headers=headers, data=await request.read() or None
    ) as answered:
        kind = answered.headers.get("Content-Type", "application/json")
        response = web.StreamResponse(status=answered.status, headers={"Content-Type": kind})
        await response.prepare(request)
        async for chunk in answered.content.iter_any():
            await response.write(chunk)
        return response


def _write_kubeconfig(path: Path, url: str) -> None:
    content = {
        "apiVersion": "v1",
        "kind": "Config",
        "clusters": [{"name": "largest", "cluster": {"server": url}}],
        "users": [{"name": "largest", "user": {"token": "of-nobody"}}],
        "contexts": [{"name": "largest", "context": {"cluster": "largest", "user": "largest"}}],
        "current-context": "largest",
    }
    path.write_text(yaml.safe_dump(content))
