"""Where the cluster keeps things, and the addresses that it uses.

There is one cluster to a machine, whatever checkout it was started from: network namespaces,
control groups and addresses are the machine's, so two would meet anyway.
"""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path

NAME = "bagpipe"
STATE = Path("/var/lib/bagpipe")
RUN = Path("/run/bagpipe")
LOGS = STATE / "logs"
PIDS = STATE / "pids"
PKI = STATE / "pki"
CONFIG = STATE / "config"
VOLUMES = STATE / "volumes"
KUBECONFIG = STATE / "kubeconfig"
RECORD = STATE / "cluster.json"
NODE_COUNT = STATE / "node-count"
LOCK = Path("/run/lock/bagpipe-cluster.lock")

# One tree of control groups holds the daemons and, below the kubelet's own group, all pods.
CGROUP = "bagpipe"
CGROUP_ROOT = Path("/sys/fs/cgroup")

# 198.18.0.0/15 is set aside for benchmarks (RFC 2544): no real network has these addresses.
SERVICE_CIDR = "10.96.0.0/16"
API_SERVICE = "10.96.0.1"
DNS_SERVICE = "10.96.0.10"
DOMAIN = "cluster.local"
POD_CIDR = "10.244.0.0/16"
API_PORT = 6443

# Each node has its own containerd, kubelet and kube-proxy; more would crowd out what is tested.
MOST_NODES = 8


def cache() -> Path:
    """The folder of everything that is worth keeping between clusters and checkouts."""
    return Path(os.environ.get("BAGPIPE_CACHE") or Path.home() / ".cache" / "bagpipe")


def sources() -> Path:
    """The folder tests/cluster of this checkout."""
    return Path(__file__).resolve().parent.parent


@dataclass(frozen=True)
class Node:
    """A node, all of whose names and addresses follow from its index."""

    index: int

    @property
    def name(self) -> str:
        return f"{NAME}-{self.index}"

    @property
    def namespace(self) -> Path:
        """The network namespace, as `ip netns add` mounts it."""
        return Path("/run/netns") / self.name

    @property
    def gateway(self) -> str:
        """The machine's end of the node's veth pair, on a /30."""
        return f"198.18.0.{4 * self.index + 1}"

    @property
    def address(self) -> str:
        return f"198.18.0.{4 * self.index + 2}"

    @property
    def peer_address(self) -> str:
        """The node's place at the switch that joins several nodes, on a /24."""
        return f"198.18.1.{self.index + 1}"

    @property
    def pod_cidr(self) -> str:
        return f"10.244.{self.index}.0/24"

    @property
    def cgroup(self) -> str:
        """The parent of the kubelet's groups; it must exist before the kubelet starts."""
        return f"{CGROUP}/{self.name}"

    @property
    def state(self) -> Path:
        return STATE / "nodes" / self.name

    @property
    def run(self) -> Path:
        return RUN / self.name

    @property
    def containerd_socket(self) -> Path:
        return self.run / "containerd.sock"


# The control plane runs in the namespace of the first node.
FIRST = Node(0)
API_SERVER = f"https://{FIRST.address}:{API_PORT}"


def nodes() -> list[Node]:
    """The nodes of the cluster that is there; the first alone where none is."""
    try:
        return first_nodes(int(NODE_COUNT.read_text()))
    except (FileNotFoundError, ValueError):
        return [FIRST]


def first_nodes(count: int) -> list[Node]:
    return [Node(index) for index in range(count)]


def possible_nodes() -> list[Node]:
    """Every node that any cluster may have had, for taking away what is left of one."""
    return first_nodes(MOST_NODES)


def node_named(name: str) -> Node | None:
    """The cluster's node of that name, if it has one."""
    return next((node for node in nodes() if node.name == name), None)
