"""The test cluster's certificates and flags for a control plane somewhere else on this machine.

A program of its own: tests/cluster knows one cluster with fixed places, and other modules take
them over when they are imported, so they are moved first, in a process where nobody minds.

Usage: PYTHONPATH=tests/cluster python3 relocated.py FOLDER API_PORT ETCD_PORT PEER_PORT
It makes FOLDER/pki and FOLDER/kubeconfig and prints each component's flags as JSON.
"""

import json
import sys
from pathlib import Path

from embedded import places

LOOPBACK = "127.0.0.1"


class OnLoopback(places.Node):
    """A node that only has the address of the machine itself."""

    @property
    def address(self) -> str:
        return LOOPBACK


def move(folder: Path, api_port: int) -> None:
    """Point everything that the cluster keeps and serves at a folder and a port."""
    places.STATE = folder
    places.PKI = folder / "pki"
    places.KUBECONFIG = folder / "kubeconfig"
    places.FIRST = OnLoopback(0)
    places.API_PORT = api_port
    places.API_SERVER = f"https://{LOOPBACK}:{api_port}"


def without(flags: list[str], *names: str) -> list[str]:
    """The flags but for some, which are replaced."""
    return [flag for flag in flags if flag.split("=")[0] not in names]


def flags_of(etcd_port: int, peer_port: int) -> dict[str, list[str]]:
    """What differs from the cluster: loopback addresses, and no port that is not asked for."""
    from embedded import control_plane  # noqa: PLC0415 - only now are its places the moved ones

    control_plane.ETCD = f"http://{LOOPBACK}:{etcd_port}"
    return {
        "etcd": [
            *without(control_plane.etcd_flags(), "--listen-peer-urls"),
            f"--listen-peer-urls=http://{LOOPBACK}:{peer_port}",
            # Nobody needs it after the machine has lost its power; a write waits for a disk else.
            "--unsafe-no-fsync",
        ],
        "kube-apiserver": [
            *control_plane.apiserver_flags(),
            f"--bind-address={LOOPBACK}",
            # An endpoint can't be a loopback address, and nobody looks the API server up by it.
            "--endpoint-reconciler-type=none",
        ],
        "kube-controller-manager": [
            *control_plane.controller_manager_flags(1),
            "--secure-port=0",
            # It takes away pods of nodes that are not there, some 40 s after a fake kubelet's work.
            "--controllers=*,-pod-garbage-collector-controller",
        ],
        "kube-scheduler": [*control_plane.scheduler_flags(), "--secure-port=0"],
    }


def main() -> None:
    folder, api_port, etcd_port, peer_port = Path(sys.argv[1]), *map(int, sys.argv[2:5])
    move(folder, api_port)
    from embedded import certificates  # noqa: PLC0415 - the same

    certificates.create([])
    print(json.dumps(flags_of(etcd_port, peer_port)))


if __name__ == "__main__":
    main()
