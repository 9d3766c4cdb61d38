"""Taking the cluster down to nothing, from whatever state it is in."""

from __future__ import annotations

import contextlib
import json
import re
import shutil
import subprocess
from pathlib import Path

from . import cgroups, network, processes
from .failure import ClusterError, wait_until
from .places import API_PORT, FIRST, NAME, RUN, STATE, Node, possible_nodes

# Folders that the kubelet, CNI and containerd's shims use whatever their configuration says.
SHARED = [
    Path("/var/lib/cni/results"),
    Path("/var/lib/cni"),
    Path("/var/log/containers"),
    Path("/var/lib/kubelet/device-plugins"),
    Path("/var/lib/kubelet"),
    Path("/run/containerd/s"),
    Path("/run/containerd/fifo"),
    Path("/run/containerd"),
]


def parse_mounts(mountinfo: str, roots: list[Path]) -> list[str]:
    """Mount points below `roots`, the latest first, so that what covers goes before."""
    points = [line.split()[4].replace("\\040", " ") for line in mountinfo.splitlines()]
    return [
        point
        for point in reversed(points)
        if any(Path(point) == root or root in Path(point).parents for root in roots)
    ]


def unmount_all() -> None:
    def unmounted() -> bool:
        points = parse_mounts(Path("/proc/self/mountinfo").read_text(), [STATE, RUN])
        for point in points:
            if subprocess.run(["umount", point], capture_output=True, check=False).returncode:
                # Busy although every process is dead: the kernel still lets go of it.
                subprocess.run(["umount", "--lazy", point], capture_output=True, check=False)
        return not points

    wait_until(f"the end of all mounts below {STATE} and {RUN}", unmounted, seconds=20)


def stop_processes() -> None:
    """The kubelet first, so that nobody restarts a container; etcd last, so that nobody waits."""
    running = processes.names()
    ranks = {name: stop_rank(name) for name in running}
    for rank in sorted(set(ranks.values())):
        processes.stop([name for name in running if ranks[name] == rank])
    cgroups.kill_all()


def stop_rank(name: str) -> int:
    """When a daemon is stopped, the lowest rank first; a node's daemons end in its index."""
    order = {"kubelet": 0, "kube-apiserver": 2, "etcd": 3}
    return order.get(re.sub(r"-\d+$", "", name), 1)


def remove_shim_sockets(node: Node) -> None:
    """A killed shim leaves its socket, whose place only its own address file names."""
    for address in node.run.glob("containerd/io.containerd.runtime.v2.task/*/*/address"):
        socket = Path(address.read_text().strip().removeprefix("unix://"))
        if socket.parent == Path("/run/containerd/s"):
            socket.unlink(missing_ok=True)


def remove_strays(node: Node) -> None:
    """Remove our files from folders that other programs may share, and then empty folders."""
    remove_shim_sockets(node)
    for result in Path("/var/lib/cni/results").glob(f"{NAME}-*"):
        result.unlink(missing_ok=True)
    for link in Path("/var/log/containers").glob("*.log"):
        if link.is_symlink() and STATE in link.readlink().parents:
            link.unlink(missing_ok=True)


def remove_loopback_results() -> None:
    """containerd 1.6 never takes back what it noted of a pod's loopback; a live pod's is kept."""
    for result in Path("/var/lib/cni/results").glob("cni-loopback-*"):
        if not any(path.exists() for path in sandboxes(result.read_text())):
            result.unlink(missing_ok=True)


def sandboxes(result: str) -> list[Path]:
    """The network namespaces that a CNI result names; none where it can't be read."""
    try:
        interfaces = json.loads(result)["result"]["interfaces"]
        return [Path(interface["sandbox"]) for interface in interfaces]
    except (ValueError, KeyError, TypeError):
        return []


def remove_netns_mount() -> None:
    """`ip netns add` mounts /run/netns on itself, once, and nothing ever takes that back."""
    folder = FIRST.namespace.parent
    if folder.is_dir() and not any(folder.iterdir()):
        subprocess.run(["umount", folder], capture_output=True, check=False)
        with contextlib.suppress(OSError):
            folder.rmdir()


def remove_discovery_cache() -> None:
    """kubectl keeps what it learnt of an API server by address; the next cluster has the same."""
    cached = Path.home() / ".kube" / "cache" / "discovery" / f"{FIRST.address}_{API_PORT}"
    shutil.rmtree(cached, ignore_errors=True)


def remove_empty_folders() -> None:
    plugins = Path("/var/lib/kubelet/device-plugins")
    others_kubelet = (plugins.parent / "pki").exists()
    if not others_kubelet:
        (plugins / "kubelet.sock").unlink(missing_ok=True)
    for folder in SHARED:
        try:
            folder.rmdir()
        except OSError:
            continue  # missing, or in use by someone else


def down() -> None:
    """Remove every process, mount, namespace, group and file of the cluster."""
    if STATE.is_dir():
        stop_processes()
    cgroups.kill_all()
    for node in possible_nodes():
        remove_strays(node)
    unmount_all()
    network.remove_switch()
    for node in possible_nodes():
        network.remove(node)
    cgroups.remove()
    for root in (RUN, STATE):
        # Looked at once more: a deletion would go on into whatever is mounted below.
        if parse_mounts(Path("/proc/self/mountinfo").read_text(), [root]):
            raise ClusterError(f"{root} is not removed: something is still mounted below it.")
        if root.exists():
            shutil.rmtree(root)
        if root.exists():
            raise ClusterError(f"{root} can't be removed; see `ls -R {root}`.")
    remove_loopback_results()
    remove_empty_folders()
    remove_netns_mount()
    remove_discovery_cache()
