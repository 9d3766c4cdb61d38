"""Who reaches drivers, executors and the operator where a network plugin enforces NetworkPolicies.

Each listening port is tried from pods that have business with it and from pods that have none,
before the chart's policies are there, when all of them are reached, and after. A cluster whose
plugin enforces none skips this: the test finds that out with a policy of its own.
"""

import json
import subprocess
from collections.abc import Iterator
from dataclasses import dataclass

import pytest

from tests.e2e import jobs
from tests.e2e import kubectl as k
from tests.e2e.conftest import ROOT
from tests.e2e.installation import SYSTEM

pytestmark = [
    pytest.mark.e2e, pytest.mark.slow, pytest.mark.timeout(900),
    pytest.mark.usefixtures("recordings"),
]  # fmt: skip

PROGRESS, METRICS = 8080, 9811
# A plugin learns of pods and policies by a watch, and writes its rules a moment later.
ENFORCED_SECONDS = 60
LABELS = {
    "stranger": {"app": "stranger"},
    # Labels of an executor, in a namespace without jobs.
    "impostor": {"app.kubernetes.io/managed-by": "bagpipe", "sim.bagpipe.io/role": "executor"},
    "reader": {"app": "reader"},
    "canary": {"app": "canary"},
}
LISTENING = """
import pathlib
ports = set()
for name, loopback in (("tcp", "0100007F"), ("tcp6", "00000000000000000000000001000000")):
    for line in pathlib.Path("/proc/net", name).read_text().splitlines()[1:]:
        address, port = line.split()[1].split(":")
        if line.split()[3] == "0A" and address != loopback and not address.endswith("0100007F"):
            ports.add(int(port, 16))
print(*sorted(ports))
"""
TRY = """
import concurrent.futures, socket, sys
def reached(port):
    try:
        socket.create_connection((sys.argv[1], port), timeout=3).close()
    except OSError:
        return False
    return True
ports = [int(port) for port in sys.argv[2:]]
with concurrent.futures.ThreadPoolExecutor(32) as pool:
    print(*(port for port, open in zip(ports, pool.map(reached, ports)) if open))
"""


@dataclass(frozen=True)
class Target:
    """A pod's address and what it listens on, or a part of it."""

    address: str
    ports: frozenset[int]


def pod_of(namespace: str, selector: str) -> k.Object:
    """The one running pod of a selector."""
    return k.await_that(
        f"a pod {selector}",
        lambda: next(
            (
                pod
                for pod in k.items(namespace, "pods", "-l", selector)
                if pod["status"].get("phase") == "Running" and pod["status"].get("podIP")
            ),
            None,
        ),
        120,
    )


def target(namespace: str, selector: str, container: str) -> Target:
    """A pod, and the ports that it listens on for others."""
    pod = pod_of(namespace, selector)
    words = ("exec", pod["metadata"]["name"], "-c", container, "--", "python3", "-c", LISTENING)
    ports = k.kubectl("-n", namespace, *words).split()
    return Target(pod["status"]["podIP"], frozenset(map(int, ports)))


def reached(namespace: str, pod: str, aim: Target) -> set[int]:
    """The ports of a target that a pod's connections reach."""
    words = ("exec", pod, "--", "python3", "-c", TRY, aim.address, *map(str, sorted(aim.ports)))
    return set(map(int, k.kubectl("-n", namespace, *words).split()))


@pytest.fixture(scope="module")
def others(namespace: str) -> Iterator[str]:
    """Another namespace, with a pod for each of LABELS."""
    name = f"{namespace}-others"
    k.create_namespace(name)
    for pod, labels in LABELS.items():
        listens = "import http.server as h; h.HTTPServer(('', 8000), h.BaseHTTPRequestHandler)"
        container = {
            "name": pod,
            "image": "bagpipe.local/ros:0.2.0",
            "imagePullPolicy": "IfNotPresent",
            "command": ["python3", "-c", f"{listens}.serve_forever()"],
            "securityContext": k.RESTRICTED,
        }
        manifest = {
            "apiVersion": "v1",
            "kind": "Pod",
            "metadata": {"name": pod, "namespace": name, "labels": labels},
            "spec": {
                "terminationGracePeriodSeconds": 0,
                "automountServiceAccountToken": False,
                "containers": [container],
            },
        }
        k.kubectl("apply", "-f", "-", given=json.dumps(manifest))
    ready = ("wait", "--for=condition=Ready", "pod", "--all", "--timeout=120s")
    k.kubectl("-n", name, *ready, seconds=140)
    yield name
    k.kubectl("delete", "namespace", name, "--wait=true", "--timeout=120s", seconds=140)


@pytest.fixture(scope="module")
def enforced(others: str) -> None:
    """Skips where a policy that lets nobody in lets somebody in."""
    canary = Target(pod_of(others, "app=canary")["status"]["podIP"], frozenset({8000}))
    assert reached(others, "stranger", canary) == {8000}
    nobody = {
        "apiVersion": "networking.k8s.io/v1",
        "kind": "NetworkPolicy",
        "metadata": {"name": "nobody", "namespace": others},
        "spec": {
            "podSelector": {"matchLabels": LABELS["canary"]},
            "policyTypes": ["Ingress"],
        },
    }
    k.kubectl("apply", "-f", "-", given=json.dumps(nobody))
    try:
        k.await_that("nobody", lambda: not reached(others, "stranger", canary), ENFORCED_SECONDS)
    except TimeoutError:
        pytest.skip("the cluster's network plugin enforces no NetworkPolicies")


@pytest.fixture
def policies(namespace: str, others: str) -> Iterator[str]:
    """The chart's policies for both, as a manifest; removed after the test."""
    reader = {
        "namespaceSelector": {"matchLabels": {"kubernetes.io/metadata.name": others}},
        "podSelector": {"matchLabels": LABELS["reader"]},
    }
    rendered = subprocess.run(
        [
            *("helm", "template", "bagpipe", str(ROOT / "charts/bagpipe"), "--namespace", SYSTEM),
            *("--show-only", "templates/network-policies.yaml", "--kube-version", "1.34"),
            *("--set", "networkPolicy.enabled=true"),
            *("--set-json", f"networkPolicy.metricsFrom={json.dumps([reader])}"),
            *("--set-json", f"jobNamespaces={json.dumps([namespace])}"),
        ],
        capture_output=True,
        text=True,
        timeout=60,
        check=True,
        env=k.tool_environment(),
    ).stdout
    yield rendered
    k.kubectl("delete", "--ignore-not-found", "-f", "-", given=rendered)


def seen(namespace: str, others: str, aim: Target) -> dict[str, set[int]]:
    """Who reaches which ports of a target."""
    found = {name: reached(others, name, aim) for name in LABELS if name != "canary"}
    return found | {"neighbour": reached(namespace, k.TOOLBOX, aim)}


def closed_to_all_but(namespace: str, others: str, aim: Target, port: int) -> None:
    """Waits until readers of metrics reach one port, and others none."""
    none = {"stranger": set[int](), "impostor": set[int](), "neighbour": set[int]()}
    wanted = none | {"reader": {port}}
    what = f"only readers to reach {aim}, and only at {port}"
    k.await_that(what, lambda: seen(namespace, others, aim) == wanted, ENFORCED_SECONDS)


def running(namespace: str, name: str) -> int:
    """How many cases of a job run now."""
    status = k.get(namespace, "simjob", name).get("status", {})
    return int(status.get("cases", {}).get("running", 0))


@pytest.mark.usefixtures("enforced")
def test_strangers_reach_nothing_and_the_job_goes_on(
    namespace: str, others: str, policies: str
) -> None:
    """Nobody but readers of metrics, and these on their ports alone; driver and executors talk."""
    watched = jobs.make_job("reached", playback={"mode": "realtime", "rate": 0.05})
    with jobs.applied(namespace, watched) as name:
        k.await_that("a case to run", lambda: running(namespace, name), 300)
        of = f"sim.bagpipe.io/job={name},sim.bagpipe.io/role"
        driver = target(namespace, f"{of}=driver", "driver")
        executor = target(namespace, f"{of}=executor", "spark")
        operator = target(SYSTEM, "app.kubernetes.io/name=bagpipe-operator", "operator")
        assert PROGRESS in driver.ports & operator.ports
        assert METRICS in executor.ports
        # Spark's own ports are there too; rosmaster and the nodes listen on loopback alone.
        assert (len(driver.ports), len(executor.ports)) == (3, 2)
        for aim in (driver, executor, operator):
            assert all(ports == aim.ports for ports in seen(namespace, others, aim).values())
        k.kubectl("apply", "-f", "-", given=policies)
        for aim, port in ((driver, PROGRESS), (executor, METRICS), (operator, PROGRESS)):
            closed_to_all_but(namespace, others, aim, port)
    # New pods under the policies: the operator asks the driver, and executors find it.
    with jobs.applied(namespace, jobs.make_job("goes-on")) as name:
        ended = jobs.ended(namespace, name, 400)
        assert ended["status"]["phase"] == "Complete", jobs.account(namespace, ended)
        assert ended["status"]["verdict"] == "Passed", jobs.account(namespace, ended)
