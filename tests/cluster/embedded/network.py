"""One network namespace per node, joined to the machine by a veth pair.

Several nodes are joined to each other by a switch: a bridge in a namespace of its own, with a
veth pair (a cable) to each node, over which go the kubelets' and the pods' traffic.

Pods can reach each other, services and the nodes; there is no route to anywhere else.
Address translation rules live and die with the namespace: the machine's own stay untouched.
"""

from __future__ import annotations

import json
import subprocess
from pathlib import Path

from .failure import ClusterError
from .places import NAME, SERVICE_CIDR, Node

UPLINK = "uplink"
PEERS = "peers"
SWITCH = f"{NAME}-switch"
SWITCH_NAMESPACE = Path("/run/netns") / SWITCH


def ip(*arguments: str, check: bool = True) -> str:
    done = subprocess.run(["ip", *arguments], capture_output=True, text=True, check=False)
    if check and done.returncode:
        raise ClusterError(f"`ip {' '.join(arguments)}` failed: {done.stderr.strip()}")
    return done.stdout


def inside(node: Node, *command: str) -> str:
    """Run a command in the node's network namespace and return what it prints.

    Not with `ip netns exec`: that mounts a /sys of its own and so hides the control groups.
    """
    full = ["nsenter", f"--net={node.namespace}", *command]
    done = subprocess.run(full, capture_output=True, text=True, check=False)
    if done.returncode:
        raise ClusterError(f"`{' '.join(command)}` in {node.name} failed: {done.stderr.strip()}")
    return done.stdout


def create(node: Node) -> None:
    ip("netns", "add", node.name)
    ip("link", "add", node.name, "type", "veth", "peer", "name", UPLINK, "netns", node.name)
    ip("address", "add", f"{node.gateway}/30", "dev", node.name)
    ip("link", "set", node.name, "up")
    inside(node, "ip", "link", "set", "lo", "up")
    inside(node, "ip", "address", "add", f"{node.address}/30", "dev", UPLINK)
    inside(node, "ip", "link", "set", UPLINK, "up")
    # There is no default route, so that what looks for the world outside (a pull of an unknown
    # image) fails at once and not after a timeout. The route for services is never taken, but
    # without one a connection is refused before its address is translated.
    inside(node, "ip", "route", "add", SERVICE_CIDR, "via", node.gateway)
    for setting in ("ipv4/ip_forward", "ipv4/conf/all/route_localnet"):
        inside(node, "sh", "-c", f"echo 1 > /proc/sys/net/{setting}")


def peer_routes(node: Node, nodes: list[Node]) -> list[list[str]]:
    """The arguments of `ip` for the ways from a node to all others and to their pods.

    What a node itself sends keeps its one address, whichever of its two links it goes by.
    """
    return [
        ["route", "add", target, "via", other.peer_address, "dev", PEERS, "src", node.address]
        for other in nodes
        if other != node
        for target in (f"{other.address}/32", other.pod_cidr)
    ]


def connect(nodes: list[Node]) -> None:
    """Join several nodes; one alone needs no switch."""
    if len(nodes) < 2:
        return
    ip("netns", "add", SWITCH)
    ip("-netns", SWITCH, "link", "add", "switch", "type", "bridge")
    ip("-netns", SWITCH, "link", "set", "switch", "up")
    for node in nodes:
        pair = ("type", "veth", "peer", "name", PEERS, "netns", node.name)
        ip("-netns", SWITCH, "link", "add", node.name, *pair)
        ip("-netns", SWITCH, "link", "set", node.name, "master", "switch", "up")
        inside(node, "ip", "address", "add", f"{node.peer_address}/24", "dev", PEERS)
        inside(node, "ip", "link", "set", PEERS, "up")
        for route in peer_routes(node, nodes):
            inside(node, "ip", *route)


def set_cable(node: Node, state: str) -> None:
    """Set the switch's end of a node's cable up or down.

    The node's own end stays as it is, as with a real cable: its addresses and routes survive.
    """
    if not SWITCH_NAMESPACE.exists():
        raise ClusterError(
            "The cluster has one node, and only the switch between several can cut one off: "
            "start it with NODES=3."
        )
    ip("-netns", SWITCH, "link", "set", node.name, state)


def cut_off(node: Node) -> bool:
    """Whether the node's cable to the others is down."""
    if not SWITCH_NAMESPACE.exists():
        return False
    (link,) = json.loads(ip("-json", "-netns", SWITCH, "link", "show", "dev", node.name))
    return "UP" not in link["flags"]


def remove_switch() -> None:
    if SWITCH_NAMESPACE.exists():
        ip("netns", "delete", SWITCH)


def remove(node: Node) -> None:
    """Remove the namespace and the pair; a namespace's end takes its devices with it."""
    if node.namespace.exists():
        ip("netns", "delete", node.name)
    if (Path("/sys/class/net") / node.name).exists():
        ip("link", "delete", node.name, check=False)
