"""What a cluster of several nodes has beyond what one node has."""

from __future__ import annotations

import json
import signal
import subprocess
from collections.abc import Iterator
from pathlib import Path

import pytest
from embedded import (
    cgroups,
    cleaning,
    control_plane,
    faults,
    lifecycle,
    network,
    node,
    places,
    processes,
    stores,
    traces,
)
from embedded.failure import ClusterError, wait_until
from embedded.places import FIRST, Node, first_nodes

MEMORY = 24_000_000  # KiB


@pytest.fixture
def three(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> list[Node]:
    """A record of three nodes, as a cluster of them leaves it."""
    count = tmp_path / "node-count"
    count.write_text("3\n")
    monkeypatch.setattr(places, "NODE_COUNT", count)
    return places.nodes()


@pytest.fixture
def sleeper(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[processes.Process]:
    """A process that is remembered as the kubelet of the second node."""
    monkeypatch.setattr(processes, "PIDS", tmp_path / "pids")
    child = subprocess.Popen(["sleep", "600"])
    yield processes.remember("kubelet-1", child.pid)
    child.kill()
    child.wait(timeout=60)


def test_one_node_is_what_there_is_without_a_record(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(places, "NODE_COUNT", tmp_path / "none")
    assert places.nodes() == [FIRST]
    (tmp_path / "none").write_text("many")
    assert places.nodes() == [FIRST]


def test_the_record_counts_the_nodes(three: list[Node]) -> None:
    assert [n.name for n in three] == ["bagpipe-0", "bagpipe-1", "bagpipe-2"]
    assert places.node_named("bagpipe-2") == Node(2)
    assert places.node_named("bagpipe-3") is None
    assert places.possible_nodes()[:3] == three


def test_every_node_has_a_way_to_every_other_and_its_pods() -> None:
    routes = {n: network.peer_routes(n, first_nodes(3)) for n in first_nodes(3)}
    assert [route[2] for route in routes[Node(1)]] == [
        "198.18.0.2/32",
        "10.244.0.0/24",
        "198.18.0.10/32",
        "10.244.2.0/24",
    ]
    assert {route[4] for route in routes[Node(1)][:2]} == {"198.18.1.1"}
    assert all(route[-1] == n.address for n, found in routes.items() for route in found)


def test_memory_is_shared_out_and_processors_are_not() -> None:
    config = node.kubelet_config(Node(1), count=3, memory=MEMORY)
    assert config["systemReserved"] == {"memory": "16000000Ki"}
    assert config["nodeLeaseDurationSeconds"] == 20
    assert config["cgroupRoot"] == "/bagpipe/bagpipe-1"
    alone = node.kubelet_config(FIRST, count=1, memory=MEMORY)
    assert set(config) - set(alone) == {"systemReserved", "nodeLeaseDurationSeconds"}


def test_reads_the_machines_memory() -> None:
    text = "MemFree:  5 kB\nMemTotal:       24684212 kB\nCached: 7 kB\n"
    assert node.machine_memory(text) == 24684212


def test_only_several_nodes_are_soon_called_lost() -> None:
    several = control_plane.controller_manager_flags(3)
    assert "--node-monitor-grace-period=20s" in several
    assert set(several) - set(control_plane.controller_manager_flags(1)) == {
        "--node-monitor-grace-period=20s"
    }


def test_every_kubelet_stops_before_anyone_else() -> None:
    names = ["etcd", "kube-apiserver", "containerd-2", "kube-proxy-1", "kubelet-0", "kubelet-12"]
    assert [cleaning.stop_rank(name) for name in names] == [3, 2, 1, 1, 0, 0]


def test_a_store_is_linked_but_for_its_databases(tmp_path: Path) -> None:
    source = tmp_path / "first" / "containerd"
    for part in stores.PARTS:
        (source / part / "blobs").mkdir(parents=True)
        (source / part / "blobs" / "layer").write_text("content")
        (source / part / "metadata.db").write_text("one")
    (source / "elsewhere").mkdir()
    target = tmp_path / "second" / "containerd"
    stores.link_store(source, target)
    assert sorted(p.name for p in target.iterdir()) == sorted(stores.PARTS)
    for part in stores.PARTS:
        assert (source / part / "blobs/layer").samefile(target / part / "blobs/layer")
        (target / part / "metadata.db").write_text("two")
        assert (source / part / "metadata.db").read_text() == "one"
        assert len(list((target / part).iterdir())) == 2


def test_a_store_that_is_missing_is_reported(tmp_path: Path) -> None:
    with pytest.raises(ClusterError, match=r"can't be linked to .*No such file"):
        stores.link_store(tmp_path / "none", tmp_path / "target")


@pytest.mark.usefixtures("three", "sleeper")
def test_another_number_of_nodes_is_refused_while_one_runs() -> None:
    lifecycle.demand_count(3)
    with pytest.raises(ClusterError, match="NODES=3 is running and NODES=1 is asked for"):
        lifecycle.demand_count(1)
    processes.stop(["kubelet-1"])
    lifecycle.demand_count(1)


@pytest.mark.usefixtures("three")
def test_a_kubelet_is_paused_resumed_and_killed(sleeper: processes.Process) -> None:
    def state() -> str:
        return Path(f"/proc/{sleeper.pid}/stat").read_text().rsplit(") ", 1)[1][0]

    faults.pause_kubelet("bagpipe-1")
    wait_until("the stop", lambda: state() == "T", seconds=60)
    faults.resume_kubelet("bagpipe-1")
    wait_until("the end of the stop", lambda: state() != "T", seconds=60)
    faults.kill_kubelet("bagpipe-1")
    assert not sleeper.alive
    with pytest.raises(ClusterError, match="kubelet of bagpipe-1 does not run"):
        faults.kill_kubelet("bagpipe-1")


@pytest.mark.usefixtures("three")
def test_an_unknown_node_is_named_with_those_there_are() -> None:
    with pytest.raises(ClusterError, match="no node x; it has bagpipe-0, bagpipe-1, bagpipe-2"):
        faults.cut_off("x")


def test_one_node_alone_can_t_be_cut_off(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(places, "NODE_COUNT", tmp_path / "none")
    monkeypatch.setattr(network, "SWITCH_NAMESPACE", tmp_path / "none")
    with pytest.raises(ClusterError, match="NODES=3"):
        faults.cut_off("bagpipe-0")
    faults.join_all()
    assert not network.cut_off(FIRST)


TASKS = """TASK       PID      STATUS
abc        4711     RUNNING
def        0        STOPPED
"""


def test_reads_containerds_list_of_tasks() -> None:
    assert faults.parse_tasks(TASKS) == {"abc": 4711}


@pytest.mark.usefixtures("three")
def test_kills_only_processes_of_the_cluster(
    sleeper: processes.Process, monkeypatch: pytest.MonkeyPatch
) -> None:
    listing = TASKS.replace("4711", str(sleeper.pid))
    monkeypatch.setattr(faults, "ctr", lambda *_: listing)
    monkeypatch.setattr(cgroups, "members", set)
    with pytest.raises(ClusterError, match="No container abc runs on bagpipe-1"):
        faults.kill_container("bagpipe-1", "containerd://abc")
    assert sleeper.alive
    monkeypatch.setattr(cgroups, "members", lambda: {sleeper.pid})
    with pytest.raises(ClusterError, match="No container def runs"):
        faults.kill_container("bagpipe-1", "def")
    pid = faults.kill_container("bagpipe-1", "containerd://abc", signal.SIGTERM)
    assert pid == sleeper.pid
    wait_until("its end", lambda: not sleeper.alive, seconds=60)


def test_a_small_volume_is_bound_to_its_claim_and_to_no_node() -> None:
    volume, claim = faults.SmallVolume("full", 16).objects("tests", "results")
    assert volume["spec"]["capacity"] == claim["spec"]["resources"]["requests"]
    assert volume["spec"]["capacity"] == {"storage": "16Mi"}
    assert volume["spec"]["accessModes"] == claim["spec"]["accessModes"] == ["ReadWriteMany"]
    assert "nodeAffinity" not in volume["spec"]
    assert claim["spec"]["volumeName"] == volume["metadata"]["name"] == "full"
    assert claim["metadata"] == {"namespace": "tests", "name": "results"}
    assert not Path(volume["spec"]["hostPath"]["path"]).is_relative_to(places.VOLUMES)


def test_traces_are_rules_of_the_clusters_addresses() -> None:
    own = ["-A KUBE-SVC -d 10.96.0.1/32", "-A POSTROUTING -s 10.244.2.0/24", ":KUBE-PROXY - [0:0]"]
    others = ["*nat", "-A POSTROUTING -s 172.17.0.0/16", ":INPUT ACCEPT [0:0]", "COMMIT"]
    assert traces.rules_of_ours("\n".join([*own, *others])) == own


def test_traces_are_files_of_the_clusters_name(tmp_path: Path) -> None:
    for name in ("bagpipe-0", "bagpipe-switch", "bagpipes", "eth0"):
        (tmp_path / name).touch()
    assert [p.name for p in traces.named(tmp_path)] == ["bagpipe-0", "bagpipe-switch"]
    assert traces.named(tmp_path / "none") == []


def test_a_loopback_note_is_ours_by_its_namespace(tmp_path: Path) -> None:
    def note(sandbox: str) -> Path:
        path = tmp_path / "cni-loopback-1-lo"
        path.write_text(json.dumps({"result": {"interfaces": [{"sandbox": sandbox}]}}))
        return path

    assert traces.of_our_pods(note("/run/bagpipe/bagpipe-1/netns/cni-1"))
    assert not traces.of_our_pods(note("/run/netns/cni-1"))
