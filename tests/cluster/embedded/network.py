"""One network namespace per node, joined to the machine by a veth pair.

Pods can reach each other, services and their node; there is no route to anywhere else.
Address translation rules live and die with the namespace: the machine's own stay untouched.
"""

from __future__ import annotations

import subprocess
from pathlib import Path

from .failure import ClusterError
from .places import SERVICE_CIDR, Node

UPLINK = "uplink"


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


def remove(node: Node) -> None:
    """Remove the namespace and the pair; a namespace's end takes its devices with it."""
    if node.namespace.exists():
        ip("netns", "delete", node.name)
    if (Path("/sys/class/net") / node.name).exists():
        ip("link", "delete", node.name, check=False)
