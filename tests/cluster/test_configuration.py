"""The configuration of the cluster's components."""

from __future__ import annotations

import json
import tomllib

from embedded import addons, certificates, containerd, control_plane, node
from embedded.places import FIRST, STATE, Node, first_nodes

MEMORY = 24_000_000  # KiB


def test_nodes_share_no_address() -> None:
    nodes = [Node(index) for index in range(4)]
    addresses = [a for n in nodes for a in (n.gateway, n.address)]
    assert addresses[:4] == ["198.18.0.1", "198.18.0.2", "198.18.0.5", "198.18.0.6"]
    assert len(set(addresses)) == 8
    assert len({n.pod_cidr for n in nodes}) == 4
    assert [n.peer_address for n in nodes[:2]] == ["198.18.1.1", "198.18.1.2"]
    assert len({n.state for n in nodes}) == len({n.namespace for n in nodes}) == 4
    assert len({n.containerd_socket for n in nodes}) == 4


def test_containerd_keeps_to_its_own_folders() -> None:
    config = tomllib.loads(containerd.config(Node(2)))
    cri = config["plugins"]["io.containerd.grpc.v1.cri"]
    assert config["root"] == "/var/lib/bagpipe/nodes/bagpipe-2/containerd"
    assert config["state"] == "/run/bagpipe/bagpipe-2/containerd"
    assert cri["restrict_oom_score_adj"] is True
    assert cri["netns_mounts_under_state_dir"] is True
    assert cri["sandbox_image"] == "bagpipe.local/pause:1"
    runtime = cri["containerd"]["runtimes"]["runc"]
    assert runtime["options"]["Root"] == "/run/bagpipe/bagpipe-2/runc"


def test_pods_get_addresses_of_their_node() -> None:
    network = json.loads(containerd.pod_network(Node(3)))
    link, ports = network["plugins"]
    assert link["type"] == "ptp"
    assert link["ipam"]["ranges"] == [[{"subnet": "10.244.3.0/24"}]]
    assert ports["type"] == "portmap"


def test_the_kubelet_never_collects_images() -> None:
    config = node.kubelet_config(FIRST, count=1, memory=MEMORY)
    assert config["imageGCHighThresholdPercent"] == 100
    assert config["evictionHard"]["nodefs.available"] == "1%"
    assert config["cgroupRoot"] == "/bagpipe/bagpipe-0"
    assert 110 <= config["maxPods"] <= 253 - 1


def test_the_proxy_leaves_the_machines_settings_alone() -> None:
    assert node.proxy_config(FIRST)["conntrack"] == {
        "maxPerCore": 0,
        "min": 0,
        "tcpCloseWaitTimeout": "0s",
        "tcpEstablishedTimeout": "0s",
    }


def test_control_plane_writes_below_its_state_only() -> None:
    flags = [
        *control_plane.etcd_flags(),
        *control_plane.apiserver_flags(),
        *control_plane.controller_manager_flags(1),
        *control_plane.scheduler_flags(),
    ]
    paths = [f.split("=", 1)[1] for f in flags if "=/" in f]
    assert len(paths) == 20
    assert all(path.startswith(str(STATE)) for path in paths)


def test_every_identity_has_a_file_of_its_own() -> None:
    files = [who.file for who in certificates.identities(first_nodes(1))]
    assert len(files) == len(set(files)) == 7
    several = [who.file for who in certificates.identities(first_nodes(3))]
    assert several == [*files, "kubelet-1", "kubelet-2"]
    kubelet = certificates.kubelet_identity(FIRST)
    assert kubelet.subject == "/O=system:nodes/CN=system:node:bagpipe-0"
    assert kubelet.names == ("DNS:bagpipe-0", "IP:198.18.0.2")


def test_dns_answers_for_the_world_that_it_does_not_exist() -> None:
    own, rest = addons.corefile().split("\n\n")
    assert own.startswith("cluster.local:53 ")
    assert "ready 198.18.0.2:8181" in own
    assert "rcode NXDOMAIN" in rest


def test_the_dns_service_leads_to_the_node() -> None:
    (_, service), (_, endpoints) = addons.dns_objects()
    assert service["spec"]["clusterIP"] == "10.96.0.10"
    assert endpoints["endpoints"][0]["addresses"] == ["198.18.0.2"]
    assert [p["port"] for p in service["spec"]["ports"]] == [53, 53]
