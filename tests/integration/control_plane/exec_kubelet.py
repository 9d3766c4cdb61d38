"""A fake kubelet that runs commands: for want of a node, as processes of this machine.

It is reached as a real one is: the API server checks who asks, and passes the websocket of `exec`
on to the address that the node's object has. Where a pod mounts a claim, its processes get a
folder.
"""

import asyncio
import ssl
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any
from uuid import uuid4

from aiohttp import WSMsgType, web
from embedded.api import ApiError

from bagpipe.cli.pulling.pod import CONTAINER, MOUNT
from tests.integration.control_plane.client import STRATEGIC_PATCH, Client, Object, core
from tests.integration.control_plane.fake_kubelet import FakeKubelet
from tests.ports import free_port

_STDOUT, _STDERR, _STATUS = (bytes([channel]) for channel in (1, 2, 3))
_PIECE_BYTES = 32 << 10
_LOOK_SECONDS = 0.1


@dataclass
class ExecKubelet:
    """Starts the pods of a namespace that mount a claim, and removes those that are to go.

    `folder` is what a claim holds. `most_bytes` of stdout come before the connection is cut, and of
    these the byte `spoiled` is another one; None for neither. `waits` is a reason and a message by
    which no container starts. If it `stalls`, it is silent instead of cutting the connection.
    """

    admin: Client
    namespace: str
    folder: Path
    most_bytes: int | None = None
    spoiled: int | None = None
    waits: tuple[str, str] | None = None
    stalls: bool = False
    node: str = field(default_factory=lambda: f"node-{uuid4().hex[:8]}")
    specs: list[Object] = field(default_factory=list)
    _over: threading.Event = field(default_factory=threading.Event)

    def look(self) -> None:
        """What a kubelet does with each of its pods, once."""
        pods = FakeKubelet(self.admin)
        for pod in self.admin.items(core(self.namespace, "pods")):
            name, meta = pod["metadata"]["name"], pod["metadata"]
            if CONTAINER not in [c["name"] for c in pod["spec"]["containers"]]:
                continue
            if "deletionTimestamp" in meta:
                pods.remove(self.namespace, name)
                continue
            if "nodeName" not in pod["spec"]:
                self._bind(name)
                self.specs.append(pod)
            if "containerStatuses" in pod["status"]:
                continue
            if self.waits:
                pods.wait(self.namespace, name, *self.waits, container=CONTAINER)
            else:
                pods.run(self.namespace, name, CONTAINER)

    def _bind(self, pod: str) -> None:
        target = {"apiVersion": "v1", "kind": "Node", "name": self.node}
        binding = {"apiVersion": "v1", "kind": "Binding", "metadata": {"name": pod}}
        path = core(self.namespace, "pods", pod) + "/binding"
        self.admin.create(path, binding | {"target": target})

    def look_on(self) -> None:
        """Looks until it is to end."""
        while not self._over.wait(_LOOK_SECONDS):
            # A pod may be deleted between its list and its binding; the next look finds the others.
            with suppress(ApiError):
                self.look()

    def end(self) -> None:
        """Looks no more."""
        self._over.set()

    async def exec(self, request: web.Request) -> web.WebSocketResponse:
        """One command, with its channels as frames of v4.channel.k8s.io."""
        socket = web.WebSocketResponse(protocols=["v4.channel.k8s.io"], max_msg_size=0)
        await socket.prepare(request)
        pod = self.admin.get(core(self.namespace, "pods", request.match_info["pod"]))
        process = await self._process(pod, request.query.getall("command"))
        fed = asyncio.create_task(_feed(socket, process))
        passed = [
            asyncio.create_task(each)
            for each in (self._pass(socket, process, fed), _words(socket, process))
        ]
        try:
            await asyncio.gather(*passed)
            await socket.send_bytes(_STATUS + _status(await process.wait()))
        except ConnectionError:
            pass  # whoever asked is gone
        finally:
            fed.cancel()
            await _end(process, passed)
            await socket.close()
        return socket

    async def _process(self, pod: Object, command: list[str]) -> asyncio.subprocess.Process:
        (container,) = pod["spec"]["containers"]
        environment = {each["name"]: each["value"] for each in container["env"]}
        program, *words = [word.replace(MOUNT, str(self.folder)) for word in command]
        assert program == "python3"
        return await asyncio.create_subprocess_exec(
            sys.executable, *words, env=environment, stdin=asyncio.subprocess.PIPE,
            stdout=asyncio.subprocess.PIPE, stderr=asyncio.subprocess.PIPE,
        )  # fmt: skip

    async def _pass(
        self, socket: web.WebSocketResponse, process: Any, fed: asyncio.Task[None]
    ) -> None:
        sent = 0
        while piece := bytearray(await process.stdout.read(_PIECE_BYTES)):
            if self.spoiled is not None and sent <= self.spoiled < sent + len(piece):
                piece[self.spoiled - sent] ^= 1
            if self.most_bytes is not None and sent + len(piece) > self.most_bytes:
                await socket.send_bytes(_STDOUT + bytes(piece[: self.most_bytes - sent]))
                if self.stalls:
                    # Until whoever asked is gone.
                    await asyncio.wait([fed])
                raise ConnectionError("cut")
            await socket.send_bytes(_STDOUT + bytes(piece))
            sent += len(piece)


async def _feed(socket: web.WebSocketResponse, process: Any) -> None:
    async for message in socket:
        if message.type == WSMsgType.BINARY and message.data[:1] == b"\0":
            process.stdin.write(message.data[1:])
            await process.stdin.drain()
    # Whoever asked is gone.
    with suppress(ProcessLookupError):
        process.kill()


async def _end(process: Any, passed: list[asyncio.Task[None]]) -> None:
    """Ends a process whose output nobody reads any more."""
    with suppress(ProcessLookupError):
        process.kill()
    await asyncio.wait(passed)
    while await process.stdout.read(_PIECE_BYTES):
        pass
    await process.wait()


async def _words(socket: web.WebSocketResponse, process: Any) -> None:
    while piece := await process.stderr.read(_PIECE_BYTES):
        await socket.send_bytes(_STDERR + piece)


def _status(code: int) -> bytes:
    if code == 0:
        return b'{"metadata":{},"status":"Success"}'
    return (
        b'{"metadata":{},"status":"Failure","reason":"NonZeroExitCode","message":"command'
        b' terminated with non-zero exit code: exit status %d"}' % code
    )


@contextmanager
def serving(admin: Client, pki: Path, namespace: str, folder: Path) -> Iterator[ExecKubelet]:
    """A node with its fake kubelet, until the block ends."""
    kubelet = ExecKubelet(admin, namespace, folder)
    port = free_port()
    nodes = "/api/v1/nodes"
    admin.create(nodes, {"metadata": {"name": kubelet.node}})
    status = {
        "addresses": [{"type": "InternalIP", "address": "127.0.0.1"}],
        "daemonEndpoints": {"kubeletEndpoint": {"Port": port}},
    }
    path = f"{nodes}/{kubelet.node}"
    admin.call("PATCH", f"{path}/status", {"status": status}, STRATEGIC_PATCH)
    loop = asyncio.new_event_loop()
    ready = threading.Event()
    serve = threading.Thread(target=_serve, args=(loop, kubelet, pki, port, ready))
    looks = threading.Thread(target=kubelet.look_on)
    serve.start()
    try:
        assert ready.wait(30)
        looks.start()
        yield kubelet
    finally:
        kubelet.end()
        if looks.ident:
            looks.join()
        loop.call_soon_threadsafe(loop.stop)
        serve.join()
        admin.delete(path)


def _serve(
    loop: asyncio.AbstractEventLoop, kubelet: ExecKubelet, pki: Path, port: int,
    ready: threading.Event,
) -> None:  # fmt: skip
    context = ssl.create_default_context(ssl.Purpose.CLIENT_AUTH)
    # The authority of the API server's kubelet client has signed it for this address.
    context.load_cert_chain(pki / "apiserver.crt", pki / "apiserver.key")
    application = web.Application()
    application.router.add_get("/exec/{namespace}/{pod}/{container}", kubelet.exec)
    runner = web.AppRunner(application, shutdown_timeout=1.0)

    async def begin() -> None:
        await runner.setup()
        await web.TCPSite(runner, "127.0.0.1", port, ssl_context=context).start()
        ready.set()

    loop.run_until_complete(begin())
    loop.run_forever()
    loop.run_until_complete(runner.cleanup())
    loop.close()
