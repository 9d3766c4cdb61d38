"""What tests do to a running cluster: cut nodes off, stop kubelets, kill containers, fill volumes.

Everything here is for root on the machine of the cluster, works on nodes by their names, and is
taken away by `down` if a test does not take it back itself.
"""

from __future__ import annotations

import os
import signal
import subprocess
from dataclasses import dataclass
from pathlib import Path

from . import builds, cgroups, network, node, processes
from .api import Object
from .containerd import ctr
from .failure import ClusterError
from .places import STATE, Node, node_named, nodes

SMALL_VOLUMES = STATE / "small-volumes"
BALLAST = ".ballast"


def known(name: str) -> Node:
    found = node_named(name)
    if found is None:
        there = ", ".join(each.name for each in nodes())
        raise ClusterError(f"The cluster has no node {name}; it has {there}.")
    return found


def cut_off(name: str) -> None:
    """Pull the cable between a node and the others: neither kubelet nor pods reach them.

    The first node has the control plane, so without it all others are cut off from the API
    server, which the machine still reaches. Calling it twice is the same as once.
    """
    network.set_cable(known(name), "down")


def join(name: str) -> None:
    """Put the cable of a node in again."""
    network.set_cable(known(name), "up")


def join_all() -> None:
    """Put all cables in again; nothing to do for a cluster of one node."""
    for each in nodes():
        if network.cut_off(each):
            network.set_cable(each, "up")


def kubelet_of(name: str) -> processes.Process:
    found = processes.recall(node.kubelet_name(known(name)))
    if found is None or not found.alive:
        raise ClusterError(f"The kubelet of {name} does not run; restart_kubelet starts it.")
    return found


def pause_kubelet(name: str) -> None:
    """Let the kubelet of a node say nothing (SIGSTOP) while its pods go on."""
    kubelet_of(name).send(signal.SIGSTOP)


def resume_kubelet(name: str) -> None:
    """Let a paused kubelet go on."""
    kubelet_of(name).send(signal.SIGCONT)


def kill_kubelet(name: str) -> None:
    """End the kubelet of a node at once (SIGKILL); its pods go on. Returns when it is gone."""
    kubelet_of(name).send(signal.SIGKILL)
    processes.stop([node.kubelet_name(known(name))])


def restart_kubelet(name: str) -> None:
    """Start the kubelet of a node again after its end."""
    each = known(name)
    found = processes.recall(node.kubelet_name(each))
    if found is not None and found.alive:
        raise ClusterError(f"The kubelet of {name} runs already; kill_kubelet ends it.")
    node.start_kubelet(each, builds.binaries())


def parse_tasks(text: str) -> dict[str, int]:
    """Container id -> pid of its first process, from what `ctr tasks list` prints."""
    rows = (line.split() for line in text.splitlines()[1:])
    return {row[0]: int(row[1]) for row in rows if len(row) > 2 and row[2] == "RUNNING"}


def kill_container(name: str, container: str, number: signal.Signals = signal.SIGKILL) -> int:
    """Signal the first process of a container and return its pid.

    `container` is the id as a pod's status gives it, with or without `containerd://`. Raises
    ClusterError if the node runs no such container.
    """
    each, wanted = known(name), container.removeprefix("containerd://")
    pid = parse_tasks(ctr(each, "tasks", "list")).get(wanted)
    # A pid counts only while it is in our groups: the container may end while we look.
    if pid is None or pid not in cgroups.members():
        raise ClusterError(f"No container {wanted} runs on {name}.")
    os.kill(pid, number)
    return pid


@dataclass(frozen=True)
class SmallVolume:
    """A volume that is soon full: a file system in memory, the same on every node.

    Its content is charged to the memory of whoever writes it, so a pod that is to fill it needs
    its size beyond what the pod itself uses.
    """

    name: str
    mebibytes: int

    @property
    def folder(self) -> Path:
        """Where the machine has it; not below the folders that the provisioner removes."""
        return SMALL_VOLUMES / self.name

    def create(self) -> None:
        """Mount it on the machine, for everyone to write. Raises FileExistsError if it is there."""
        self.folder.mkdir(parents=True)
        options = f"size={self.mebibytes}m,mode=1777"
        command = ["mount", "-t", "tmpfs", "-o", options, self.name, str(self.folder)]
        done = subprocess.run(command, capture_output=True, text=True, check=False)
        if done.returncode:
            raise ClusterError(f"{self.folder} can't be mounted: {done.stderr.strip()}")

    def objects(self, namespace: str, claim: str) -> list[Object]:
        """A PersistentVolume and the claim that is bound to it, ReadWriteMany, to be applied."""
        modes, storage = ["ReadWriteMany"], {"storage": f"{self.mebibytes}Mi"}
        reference = {"namespace": namespace, "name": claim}
        volume = {
            "storageClassName": "",
            "capacity": storage,
            "accessModes": modes,
            "persistentVolumeReclaimPolicy": "Retain",
            "hostPath": {"path": str(self.folder), "type": "Directory"},
            "claimRef": {"apiVersion": "v1", "kind": "PersistentVolumeClaim", **reference},
        }
        request = {
            "storageClassName": "",
            "volumeName": self.name,
            "accessModes": modes,
            "resources": {"requests": storage},
        }
        head = {"apiVersion": "v1"}
        return [
            {**head, "kind": "PersistentVolume", "metadata": {"name": self.name}, "spec": volume},
            {**head, "kind": "PersistentVolumeClaim", "metadata": reference, "spec": request},
        ]

    def free(self) -> int:
        """Free bytes."""
        found = os.statvfs(self.folder)
        return found.f_bavail * found.f_frsize

    def fill(self, leave: int = 0) -> None:
        """Take all space but `leave` bytes with a file of the machine's own."""
        with (self.folder / BALLAST).open("ab") as file:
            wanted = self.free() - leave
            if wanted > 0:
                os.posix_fallocate(file.fileno(), file.seek(0, os.SEEK_END), wanted)

    def relieve(self) -> None:
        """Give the space of `fill` back."""
        (self.folder / BALLAST).unlink(missing_ok=True)

    def remove(self) -> None:
        """Unmount and remove it; `down` does so as well. No pod may use it any more."""
        subprocess.run(["umount", "--lazy", str(self.folder)], capture_output=True, check=False)
        self.folder.rmdir()
