"""The load on the API server: objects in and out, and watches that note when something was seen.

A client of the bench's own, so that nothing of the operator's is measured by itself.
"""

import asyncio
import base64
import contextlib
import json
import ssl
import tempfile
from collections.abc import AsyncIterator, Awaitable, Callable, Iterable
from pathlib import Path
from typing import Any

import aiohttp
import yaml

Object = dict[str, Any]
REQUEST_SECONDS = 60.0
MOST_TRIES = 10
JOBS = "/apis/sim.bagpipe.io/v1alpha1/namespaces/{}/simulationjobs"
# Requests that are under way at once; an API server lets an administrator have many more.
AT_ONCE = 32


class RefusedError(RuntimeError):
    """The API server refused; `status` is the HTTP status."""

    def __init__(self, status: int, text: str) -> None:
        super().__init__(f"the API server answered {status}: {text[:500]}")
        self.status = status


class Client:
    """One session with the API server."""

    def __init__(self, session: aiohttp.ClientSession, server: str) -> None:
        self._session = session
        self._server = server

    async def call(
        self, method: str, path: str, body: Object | None = None, kind: str = "json"
    ) -> Object:
        """The answer; raises RefusedError, or what aiohttp raises when nobody answers."""
        headers = {"Content-Type": f"application/{kind}", "Accept": "application/json"}
        data = None if body is None else json.dumps(body)
        async with self._session.request(
            method, self._server + path, data=data, headers=headers
        ) as response:
            text = await response.text()
            if response.status >= 400:
                raise RefusedError(response.status, text)
            answer: Object = json.loads(text)
            return answer

    async def create(self, path: str, body: Object) -> Object:
        return await self.call("POST", path, body)

    async def create_once(self, path: str, body: Object) -> None:
        """Creates an object unless it is there."""
        try:
            await self.create(path, body)
        except RefusedError as refused:
            if refused.status != 409:
                raise

    async def set_status(self, path: str, status: Object) -> Object:
        return await self.call("PATCH", f"{path}/status", {"status": status}, "merge-patch+json")

    async def delete(self, path: str) -> None:
        """Deletes an object; one that is gone already is no error."""
        try:
            await self.call("DELETE", path)
        except RefusedError as refused:
            if refused.status != 404:
                raise

    async def items(self, path: str) -> list[Object]:
        found: list[Object] = (await self.call("GET", path))["items"]
        return found

    async def watch(self, path: str, take: Callable[[str, Object], None]) -> None:
        """Calls `take(type, object)` for all that is there and all that comes, until cancelled.

        The API server ends a watch that can't keep up, and those of a new CRD, whose storage it
        creates again in the first seconds; the watch goes on where it was.
        """
        version, refused = "0", ""
        for _ in range(MOST_TRIES):
            while not refused:
                version, refused = await self._watch_once(path, take, version)
            await asyncio.sleep(1)
            version, text, refused = "0", refused, ""
        raise RuntimeError(f"{path} can't be watched: {text[:500]}")

    @contextlib.asynccontextmanager
    async def watched(self, path: str, take: Callable[[str, Object], None]) -> AsyncIterator[None]:
        """`watch` beside the block; the error of one that broke is raised at the block's end."""
        task = asyncio.create_task(self.watch(path, take))
        try:
            yield
        finally:
            broke = task.done()
            task.cancel()
            (error,) = await asyncio.gather(task, return_exceptions=True)
            if broke and isinstance(error, Exception):
                raise error

    async def _watch_once(
        self, path: str, take: Callable[[str, Object], None], version: str
    ) -> tuple[str, str]:
        """Watches until the API server ends it: the last version seen, why it can't go on."""
        timeout = aiohttp.ClientTimeout(total=None, sock_connect=REQUEST_SECONDS)
        query = {"watch": "1", "resourceVersion": version}
        async with self._session.get(
            self._server + path, params=query, timeout=timeout
        ) as response:
            if response.status != 200:
                return version, await response.text()
            async for line in response.content:
                event = json.loads(line)
                if event["type"] == "ERROR":
                    return version, line.decode()
                version = event["object"]["metadata"]["resourceVersion"]
                take(event["type"], event["object"])
        return version, ""


@contextlib.asynccontextmanager
async def connected(kubeconfig: Path) -> AsyncIterator[Client]:
    """A client as the kubeconfig's user, who comes with a certificate."""
    server, context = _read(kubeconfig)
    connector = aiohttp.TCPConnector(ssl=context, limit=0)
    timeout = aiohttp.ClientTimeout(total=REQUEST_SECONDS)
    async with aiohttp.ClientSession(
        connector=connector, timeout=timeout, read_bufsize=1 << 22
    ) as session:
        yield Client(session, server)


def _read(kubeconfig: Path) -> tuple[str, ssl.SSLContext]:
    """The API server's address, and how to speak to it."""
    config = yaml.safe_load(kubeconfig.read_text())
    cluster, user = config["clusters"][0]["cluster"], config["users"][0]["user"]
    context = ssl.create_default_context(cadata=_bytes(cluster, "certificate-authority").decode())
    with tempfile.TemporaryDirectory() as folder:
        certificate, key = Path(folder, "crt"), Path(folder, "key")
        certificate.write_bytes(_bytes(user, "client-certificate"))
        key.touch(mode=0o600)
        key.write_bytes(_bytes(user, "client-key"))
        context.load_cert_chain(certificate, key)
    return cluster["server"], context


def _bytes(section: Object, name: str) -> bytes:
    """A certificate or key, which a kubeconfig carries in itself or names as a file."""
    if f"{name}-data" in section:
        return base64.b64decode(section[f"{name}-data"])
    return Path(section[name]).read_bytes()


async def all_of(calls: Iterable[Awaitable[Any]], at_once: int = AT_ONCE) -> None:
    """Awaits calls, so many at once; the first that fails ends it."""
    free = asyncio.Semaphore(at_once)

    async def one(call: Awaitable[Any]) -> None:
        async with free:
            await call

    await asyncio.gather(*(one(call) for call in calls))
