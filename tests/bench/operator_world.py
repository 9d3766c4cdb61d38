"""What the operator's bench runs on: a real control plane, KWOK's nodes, and the operator itself.

Real: etcd, API server, controllers, scheduler, and the operator as a process on one processor.
Fake: the nodes (KWOK says of every pod that it runs), and in them the drivers (operator_drivers).
"""

import asyncio
import contextlib
import json
import os
import re
import subprocess
import sys
import tempfile
import time
from collections.abc import AsyncIterator, Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path

import aiohttp
import yaml
from embedded import builds

from tests.bench.operator_api import Client, Object, connected
from tests.bench.operator_drivers import POD_RANGE
from tests.integration.control_plane import server
from tests.integration.storage.servers import Server
from tests.ports import free_port

ROOT = Path(__file__).parents[2]
OPERATOR = Path(sys.executable).with_name("bagpipe-operator")
STAGES = Path(__file__).with_name("operator_kwok.yaml")
NODES = 10
READY_SECONDS = 60.0
NAMESPACE = "bench"
ACCOUNTS = ("bagpipe-driver", "bagpipe-executor")
# The operator has the last processor; everything else runs wherever the kernel puts it.
PROCESSOR = (os.cpu_count() or 1) - 1


def compiled(folder: Path) -> dict[str, str]:
    """The environment of a Python whose modules are compiled, as those in the image are."""
    environment = {"PYTHONDONTWRITEBYTECODE": "", "PYTHONPYCACHEPREFIX": str(folder)}
    if not folder.exists():
        subprocess.run(
            [sys.executable, "-c", "import bagpipe_operator.main"],
            env=os.environ | environment,
            check=True,
        )
    return environment


@dataclass
class Operator:
    """`bagpipe-operator` of this checkout, pinned to one processor."""

    kubeconfig: Path
    log: Path
    port: int = field(default_factory=free_port)
    server: Server = field(init=False)

    def __post_init__(self) -> None:
        environment = {
            "KUBECONFIG": str(self.kubeconfig),
            "BAGPIPE_LISTEN_HOST": "127.0.0.1",
            "BAGPIPE_LISTEN_PORT": str(self.port),
            **compiled(self.log.parent / "bytecode"),
        }
        command = [*dying_with_us(), "taskset", "--cpu-list", str(PROCESSOR), str(OPERATOR)]
        self.server = Server(command, self.log, environment)

    def start(self) -> None:
        self.server.start()

    def kill(self) -> None:
        """SIGKILL, so that it can't finish anything."""
        self.server.kill()

    async def ready(self, seconds: float = READY_SECONDS) -> None:
        """Waits until it is ready and leads; TimeoutError holds the end of its log."""
        deadline = time.monotonic() + seconds
        while not await self._leads():
            if time.monotonic() > deadline or not self.server.alive:
                log = self.log.read_text(errors="replace")[-3000:]
                raise TimeoutError(f"the operator does not lead after {seconds} s: {log}")
            await asyncio.sleep(0.05)

    async def _leads(self) -> bool:
        ready, _ = await self.ask("/readyz")
        return ready == 200 and "\nbagpipe_leader 1.0\n" in (await self.ask("/metrics"))[1]

    async def ask(self, path: str) -> tuple[int, str]:
        """Status and text of /readyz or /metrics; status 0 when nobody answers."""
        timeout = aiohttp.ClientTimeout(total=10)
        url = f"http://127.0.0.1:{self.port}{path}"
        try:
            async with (
                aiohttp.ClientSession(timeout=timeout) as session,
                session.get(url) as response,
            ):
                return response.status, await response.text()
        except (aiohttp.ClientError, TimeoutError):
            return 0, ""

    @property
    def pid(self) -> int:
        process = self.server._process
        if process is None:
            raise RuntimeError("the operator was never started")
        return process.pid

    def peak_mib(self) -> float:
        """The most resident memory that it ever had, in MiB."""
        status = Path(f"/proc/{self.pid}/status").read_text()
        found = re.search(r"VmHWM:\s+(\d+) kB", status)
        if found is None:
            raise RuntimeError(f"the kernel does not report the memory of process {self.pid}")
        return int(found[1]) / 1024

    def processor_seconds(self) -> float:
        """The processor time that it has used, of user and kernel."""
        fields = Path(f"/proc/{self.pid}/stat").read_text().rsplit(")", 1)[1].split()
        return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


@dataclass
class World:
    """A fresh cluster with an operator that is not started yet."""

    client: Client
    operator: Operator
    kubeconfig: Path
    folder: Path
    plane: server.ControlPlane


@contextlib.asynccontextmanager
async def fresh(more_crds: Path | None = None) -> AsyncIterator[World]:
    """A control plane, its scheduler, KWOK with its nodes, the CRDs and a namespace for jobs.

    `more_crds` is a folder with those of somebody else.
    """
    with (
        tempfile.TemporaryDirectory(prefix="bagpipe-bench-") as name,
        _plane(more_crds) as plane,
        _kwok(plane.kubeconfig, Path(name, "kwok.log")) as kwok,
    ):
        folder = Path(name)
        async with connected(plane.kubeconfig) as client:
            await _install(client)
            plane.start_scheduler()
            kwok.start()
            await _await_nodes(client)
            operator = Operator(plane.kubeconfig, folder / "operator.log")
            try:
                yield World(client, operator, plane.kubeconfig, folder, plane)
            finally:
                if operator.server.alive:
                    operator.kill()


def plane_alone() -> contextlib.AbstractContextManager[server.ControlPlane]:
    """A control plane with the CRDs, without nodes."""
    return _plane(None)


@contextlib.contextmanager
def _plane(more_crds: Path | None) -> Iterator[server.ControlPlane]:
    folders = [ROOT / "crds", *([more_crds] if more_crds else [])]
    crds = [
        yaml.safe_load(path.read_text())
        for folder in folders
        for path in sorted(folder.glob("*.yaml"))
    ]
    plane = server.prepare()
    # They hold themselves back to 20 and 50 calls a second, which would be what is measured.
    for name in ("kube-controller-manager", "kube-scheduler"):
        plane.servers[name].command += ["--kube-api-qps=1000", "--kube-api-burst=2000"]
    try:
        plane.start(crds)
        yield plane
    finally:
        plane.stop()


@contextlib.contextmanager
def _kwok(kubeconfig: Path, log: Path) -> Iterator[Server]:
    """KWOK, not yet started, that plays the kubelet of every node as STAGES says."""
    program = builds.ensure(builds.KWOK) / "kwok"
    flags = [
        f"--kubeconfig={kubeconfig}", f"--config={STAGES}", f"--cidr={POD_RANGE}",
        "--manage-all-nodes=true", "--node-ip=127.0.0.1", "--node-lease-duration-seconds=40",
    ]  # fmt: skip
    # In a folder of its own, so that no configuration of the machine's counts.
    environment = {"KWOK_WORKDIR": str(log.parent)}
    process = Server([*dying_with_us(), str(program), *flags], log, environment)
    try:
        yield process
    finally:
        if process.alive:
            process.kill()


def dying_with_us() -> list[str]:
    """Whatever way the bench ends, the kernel then ends what it started."""
    return ["setpriv", "--pdeathsig", "KILL", "--"]


async def _install(client: Client) -> None:
    await client.create("/api/v1/namespaces", {"metadata": {"name": NAMESPACE}})
    for name in ACCOUNTS:
        account = {"metadata": {"name": name}, "automountServiceAccountToken": False}
        await client.create(f"/api/v1/namespaces/{NAMESPACE}/serviceaccounts", account)
    for number in range(NODES):
        await client.create("/api/v1/nodes", node(number))


def node(number: int) -> Object:
    """A node of KWOK's with room for everything that the bench creates."""
    room = {"cpu": "10k", "memory": "100Ti", "pods": "100k"}
    # As a kubelet labels its node; the operator's pods select by it (BAGPIPE_ARCHITECTURE).
    labels = {"kubernetes.io/arch": "amd64", "kubernetes.io/os": "linux"}
    return {
        "metadata": {
            "name": f"kwok-{number}",
            "labels": labels,
            "annotations": {"kwok.x-k8s.io/node": "fake"},
        },
        "status": {"allocatable": room, "capacity": room},
    }


async def _await_nodes(client: Client) -> None:
    for number in range(NODES):
        await _until(client, f"/api/v1/nodes/kwok-{number}", _is_ready)


def _is_ready(obj: Object) -> bool:
    conditions = (obj.get("status") or {}).get("conditions") or []
    return any(c["type"] == "Ready" and c["status"] == "True" for c in conditions)


async def _until(client: Client, path: str, holds: Callable[[Object], bool]) -> None:
    deadline = time.monotonic() + READY_SECONDS
    while not holds(found := await client.call("GET", path)):
        if time.monotonic() > deadline:
            raise TimeoutError(f"{path} is not ready: {json.dumps(found.get('status'))[:1000]}")
        await asyncio.sleep(0.1)
