"""A throwaway control plane on loopback: a real API server with its etcd and its controllers.

There is no node and no kubelet, so no pod ever starts; fake_kubelet.py says what one would say.
"""

import json
import shutil
import subprocess
import sys
import tempfile
import time
from dataclasses import dataclass, field
from pathlib import Path

from embedded import builds
from embedded.control_plane import SELDOM_COLLECTED

from tests.integration.control_plane.client import Client, Object, core
from tests.integration.storage.servers import Server
from tests.ports import free_port
from tests.waiting import PATIENCE, wait_until

CLUSTER = Path(__file__).parents[2] / "cluster"
# Tests may be killed before they can clean up; the kernel then ends what they started.
DIES_WITH_US = ["setpriv", "--pdeathsig", "KILL", "--"]
CRDS = "/apis/apiextensions.k8s.io/v1/customresourcedefinitions"


def binaries() -> Path:
    """The folder of the cluster's multi-call program; built where the cache has it not."""
    return builds.ensure(builds.named("kubernetes"))


@dataclass
class ControlPlane:
    """The processes, each in a session of its own, and what is needed to use them."""

    folder: Path
    admin: Client
    servers: dict[str, Server] = field(default_factory=dict)
    start_seconds: float = 0.0

    @property
    def kubeconfig(self) -> Path:
        """The administrator's."""
        return self.folder / "kubeconfig"

    def start(self, crds: list[Object]) -> None:
        """Starts everything and waits until jobs and pods could be created."""
        began = time.monotonic()
        self.servers["etcd"].start()
        self.start_api_server()
        # Before the garbage collector, which looks for new kinds every half minute only.
        for crd in crds:
            install_crd(self.admin, crd)
        controllers = self.servers["kube-controller-manager"]
        controllers.start()
        # It has no port here; its work shows that it runs.
        account = "/api/v1/namespaces/default/serviceaccounts/default"
        controllers.await_ready(lambda: self.admin.exists(account), PATIENCE)
        self.start_seconds = time.monotonic() - began

    def start_scheduler(self) -> None:
        """Starts the scheduler too, which calls all pods unschedulable where there is no node."""
        self.servers["kube-scheduler"].start()

    def stop_api_server(self) -> None:
        """Ends the API server at once; its watchers' connections break."""
        self.servers["kube-apiserver"].kill()

    def start_api_server(self) -> None:
        """Starts it again on the same port and waits until it serves."""
        server = self.servers["kube-apiserver"]
        server.start()
        server.await_ready(self.admin.healthy, PATIENCE)

    def stop(self) -> None:
        """Ends every process by its pid and removes the folder."""
        for server in reversed(self.servers.values()):
            server.kill()
        shutil.rmtree(self.folder)

    def token(self, namespace: str, account: str, pod: str = "") -> str:
        """A real token of a ServiceAccount, for an hour; a pod's as its kubelet asks for it."""
        path = f"/api/v1/namespaces/{namespace}/serviceaccounts/{account}/token"
        spec: Object = {"expirationSeconds": 3600}
        if pod:
            uid = self.admin.get(core(namespace, "pods", pod))["metadata"]["uid"]
            bound = {"apiVersion": "v1", "kind": "Pod", "name": pod, "uid": uid}
            spec["boundObjectRef"] = bound
        request = {
            "apiVersion": "authentication.k8s.io/v1",
            "kind": "TokenRequest",
            "spec": spec,
        }
        return str(self.admin.create(path, request)["status"]["token"])

    def write_kubeconfig(self, path: Path, token: str) -> None:
        """A kubeconfig for whoever has the token, readable by this user alone."""
        config = json.loads(self.kubeconfig.read_text())
        config["users"][0]["user"] = {"token": token}
        path.touch(mode=0o600)
        path.write_text(json.dumps(config))


def install_crd(admin: Client, crd: Object) -> None:
    """Creates a CRD and waits until clients find its kind."""
    admin.create(CRDS, crd)
    names, group = crd["spec"]["names"], crd["spec"]["group"]

    def found() -> bool:
        path = f"/apis/{group}/{crd['spec']['versions'][0]['name']}"
        return admin.exists(path) and any(
            kind["name"] == names["plural"] for kind in admin.get(path)["resources"]
        )

    wait_until(found, PATIENCE, f"the API server does not serve {names['plural']}")


def prepare() -> ControlPlane:
    """A control plane with its folder, ports and certificates, not yet started."""
    programs = binaries()
    folder = Path(tempfile.mkdtemp(prefix="bagpipe-control-plane-"))
    ports = [free_port() for _ in range(3)]
    done = subprocess.run(
        [sys.executable, str(Path(__file__).with_name("relocated.py")), str(folder),
         *map(str, ports)],
        env={"PYTHONPATH": str(CLUSTER), "PATH": "/usr/bin:/bin"},
        capture_output=True, text=True, timeout=60, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    pki = folder / "pki"
    url = f"https://127.0.0.1:{ports[0]}"
    admin = Client(url, pki / "ca.crt", pki / "admin.crt", pki / "admin.key")
    servers = {
        name: Server(
            [*DIES_WITH_US, str(programs / name), *flags], folder / f"{name}.log", SELDOM_COLLECTED
        )
        for name, flags in json.loads(done.stdout).items()
    }
    return ControlPlane(folder, admin, servers)
