"""Several nodes of the embedded cluster: how they reach each other, and what their loss is like.

make test-nodes runs it; it needs `make cluster NODES=3` and not the chart.
"""

import itertools
import os
import time
import uuid
from collections.abc import Iterator

import pytest
from embedded import faults

from tests.e2e import kubectl as k
from tests.e2e import nodes

pytestmark = pytest.mark.nodes

NODES = ["bagpipe-0", "bagpipe-1", "bagpipe-2"]
LAST = NODES[-1]
MEBIBYTE = 2**20


@pytest.fixture(scope="module")
def room() -> Iterator[str]:
    """A namespace with a pod on each node, named as it, and claims that all of them mount."""
    if os.geteuid() or nodes.names() != NODES:
        pytest.skip("needs root and `make cluster NODES=3`")
    small = faults.SmallVolume(f"small-{uuid.uuid4().hex[:6]}", 16)
    small.create()
    with nodes.namespace(f"bagpipe-nodes-{uuid.uuid4().hex[:6]}") as name:
        shared = nodes.claim(name, "shared", "ReadWriteMany")
        pods = [nodes.pod(name, each, each, ("shared", "small")) for each in NODES]
        nodes.apply([shared, *small.objects(name, "small"), nodes.service(name), *pods])
        k.kubectl("-n", name, "wait", "--for=condition=Ready", "pods", "--all", "--timeout=90s")
        yield name
        faults.join_all()
    k.kubectl("delete", "persistentvolume", small.name)
    small.remove()


@pytest.fixture
def small(room: str) -> faults.SmallVolume:
    """The volume behind the claim `small`."""
    bound = k.get(room, "persistentvolumeclaim", "small")["spec"]["volumeName"]
    return faults.SmallVolume(bound, 16)


@pytest.fixture
def addresses(room: str) -> dict[str, str]:
    """The pod of each node -> its address."""
    return {each: k.get(room, "pod", each)["status"]["podIP"] for each in NODES}


def await_ready(node: str, wanted: bool, seconds: float) -> float:
    """Wait until a node is called ready, or not, and return how long that took in seconds."""
    began = time.monotonic()
    what = f"{node} to be {'ready' if wanted else 'not ready'}"
    k.await_that(what, lambda: nodes.ready(node) == wanted, seconds)
    return time.monotonic() - began


def test_three_nodes_are_ready_with_a_third_of_the_memory_each(room: str) -> None:
    found = k.items(room, "nodes")
    assert all(nodes.ready(each["metadata"]["name"]) for each in found)
    addresses = [a["address"] for n in found for a in n["status"]["addresses"]]
    assert [a for a in addresses if a.startswith("198.")] == [
        "198.18.0.2",
        "198.18.0.6",
        "198.18.0.10",
    ]
    kibibytes = [
        {
            part: int(each["status"][part]["memory"].removesuffix("Ki"))
            for part in ("allocatable", "capacity")
        }
        for each in found
    ]
    assert sum(each["allocatable"] for each in kibibytes) <= kibibytes[0]["capacity"]


def test_each_pod_runs_on_its_node_with_an_address_of_it(
    room: str, addresses: dict[str, str]
) -> None:
    placed = {each: k.get(room, "pod", each)["spec"]["nodeName"] for each in NODES}
    assert placed == {each: each for each in NODES}
    prefixes = [addresses[name].rsplit(".", 1)[0] for name in NODES]
    assert prefixes == ["10.244.0", "10.244.1", "10.244.2"]


@pytest.mark.parametrize(("one", "other"), list(itertools.product(NODES, NODES)))
def test_pods_reach_each_other(room: str, addresses: dict[str, str], one: str, other: str) -> None:
    assert nodes.fetch(room, one, addresses[other]) == other


@pytest.mark.parametrize("node", NODES)
def test_names_and_services_work_from_each_node(room: str, node: str) -> None:
    name = f"server.{room}.svc.cluster.local"
    found = nodes.run(room, node, "getent", "hosts", name).split()
    assert found[1] == name
    assert found[0].startswith("10.96.")

    answered: set[str] = set()

    def everyone() -> bool:
        answered.add(nodes.fetch(room, node, "server", 80))
        return answered == set(NODES)

    k.await_that("an answer from behind the service of each node", everyone, 60, every=0.0)
    kubernetes = nodes.run(room, node, "getent", "hosts", "kubernetes.default").split()
    assert kubernetes[0] == "10.96.0.1"


@pytest.mark.parametrize("node", NODES)
def test_logs_and_exec_reach_each_node(room: str, node: str) -> None:
    lines = k.kubectl("-n", room, "logs", node).splitlines()
    assert lines[0] == f"serving as {node}"
    assert nodes.run(room, node, "hostname") == f"{node}\n"


@pytest.mark.parametrize("folder", ["/shared", "/small"])
def test_a_claim_for_many_is_one_folder_on_all_nodes(room: str, folder: str) -> None:
    for node in NODES:
        nodes.run(room, node, "sh", "-c", f"echo from {node} > {folder}/{node}")
    for node in NODES:
        found = nodes.run(room, node, "sh", "-c", f"cat {folder}/bagpipe-*").splitlines()
        assert found == [f"from {each}" for each in NODES]


def test_a_claim_for_one_keeps_its_pods_on_one_node(room: str) -> None:
    own = nodes.claim(room, "own", "ReadWriteOnce")
    nodes.apply([own, nodes.pod(room, "first", LAST, ("own",))])
    try:
        k.kubectl("-n", room, "wait", "--for=condition=Ready", "pod/first", "--timeout=60s")
        nodes.apply([nodes.pod(room, "second", NODES[0], ("own",))])

        def refused() -> str | None:
            for each in k.get(room, "pod", "second")["status"].get("conditions", []):
                if each["type"] == "PodScheduled" and each["status"] == "False":
                    return str(each["message"])
            return None

        assert "PersistentVolume's node affinity" in k.await_that(
            "the scheduler's word", refused, 30
        )
    finally:
        k.kubectl("-n", room, "delete", "pods/first", "pods/second", "--wait=true")


def test_a_full_volume_is_full_on_every_node(room: str, small: faults.SmallVolume) -> None:
    write = ["sh", "-c", "head -c 65536 /dev/zero > /small/written"]
    assert 15 * MEBIBYTE < small.free() <= 16 * MEBIBYTE
    small.fill()
    assert small.free() == 0
    for node in NODES:
        with pytest.raises(k.KubectlError, match="No space left on device"):
            nodes.run(room, node, *write)
    small.relieve()
    for node in NODES:
        nodes.run(room, node, *write)


def test_a_killed_container_starts_again(room: str) -> None:
    def container() -> k.Object:
        found: k.Object = k.get(room, "pod", LAST)["status"]["containerStatuses"][0]
        return found

    before = container()
    faults.kill_container(LAST, before["containerID"])

    def restarted() -> bool:
        return bool(container()["restartCount"] == before["restartCount"] + 1)

    k.await_that("the container's restart", restarted, 60)
    last = container()["lastState"]["terminated"]
    assert last["exitCode"] == 137
    assert last["containerID"] == before["containerID"]
    k.kubectl("-n", room, "wait", "--for=condition=Ready", f"pod/{LAST}", "--timeout=60s")


@pytest.mark.timeout(300)
def test_a_node_that_is_cut_off_is_called_lost_and_comes_back(
    room: str, addresses: dict[str, str]
) -> None:
    faults.cut_off(LAST)
    lost = await_ready(LAST, False, 60)
    with pytest.raises(k.KubectlError):
        nodes.fetch(room, NODES[0], addresses[LAST])
    assert nodes.fetch(room, NODES[0], addresses[NODES[1]]) == NODES[1]
    faults.join(LAST)
    back = await_ready(LAST, True, 90)
    print(f"{LAST} was called lost after {lost:.1f} s and ready {back:.1f} s after it was joined")
    assert nodes.fetch(room, NODES[0], addresses[LAST]) == LAST
    assert nodes.fetch(room, LAST, addresses[NODES[0]]) == NODES[0]
    assert nodes.run(room, LAST, "hostname") == f"{LAST}\n"


@pytest.mark.timeout(300)
def test_a_killed_kubelet_loses_the_node_and_no_pod(room: str, addresses: dict[str, str]) -> None:
    before = k.get(room, "pod", LAST)["status"]["containerStatuses"][0]
    faults.kill_kubelet(LAST)
    await_ready(LAST, False, 60)
    assert nodes.fetch(room, NODES[0], addresses[LAST]) == LAST
    faults.restart_kubelet(LAST)
    await_ready(LAST, True, 60)
    k.kubectl("-n", room, "wait", "--for=condition=Ready", f"pod/{LAST}", "--timeout=60s")
    after = k.get(room, "pod", LAST)["status"]["containerStatuses"][0]
    assert after["containerID"] == before["containerID"]
    assert after["restartCount"] == before["restartCount"]


@pytest.mark.timeout(300)
@pytest.mark.usefixtures("room")
def test_a_paused_kubelet_loses_the_node_until_it_goes_on() -> None:
    faults.pause_kubelet(LAST)
    try:
        await_ready(LAST, False, 60)
    finally:
        faults.resume_kubelet(LAST)
    await_ready(LAST, True, 60)
