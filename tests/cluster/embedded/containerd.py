"""containerd and the network of pods, with every path inside the node's own folders."""

from __future__ import annotations

import json
import subprocess
from pathlib import Path

from . import oci
from .failure import ClusterError
from .places import CONFIG, NAME, STATE, Node
from .processes import await_ready, start

PAUSE = "bagpipe.local/pause:1"
CNI_PLUGINS = Path("/usr/lib/cni")


def config(node: Node) -> str:
    """containerd's configuration, format 2 (containerd 1.5 and later)."""
    return f"""version = 2
root = "{root(node)}"
state = "{node.run}/containerd"
disabled_plugins = ["io.containerd.internal.v1.opt", "io.containerd.tracing.processor.v1.otlp",
  "io.containerd.snapshotter.v1.aufs", "io.containerd.snapshotter.v1.btrfs",
  "io.containerd.snapshotter.v1.devmapper", "io.containerd.snapshotter.v1.zfs"]
oom_score = 0

[grpc]
  address = "{node.containerd_socket}"

[plugins."io.containerd.grpc.v1.cri"]
  sandbox_image = "{PAUSE}"
  # Lowering a score of the OOM killer needs CAP_SYS_RESOURCE; without this line runc then
  # fails with "can't get final child's PID from pipe: EOF".
  restrict_oom_score_adj = true
  netns_mounts_under_state_dir = true
  disable_tcp_service = true
  stream_server_address = "127.0.0.1"
  [plugins."io.containerd.grpc.v1.cri".cni]
    bin_dir = "{CNI_PLUGINS}"
    conf_dir = "{CONFIG}/cni-{node.index}"
  [plugins."io.containerd.grpc.v1.cri".containerd]
    snapshotter = "overlayfs"
    [plugins."io.containerd.grpc.v1.cri".containerd.runtimes.runc]
      runtime_type = "io.containerd.runc.v2"
      [plugins."io.containerd.grpc.v1.cri".containerd.runtimes.runc.options]
        Root = "{node.run}/runc"
        SystemdCgroup = false
"""


def pod_network(node: Node) -> str:
    """A point-to-point link for each pod. A bridge would pass answers between two pods by the
    address translation of services unless the kernel's br_netfilter module is loaded.
    """
    return json.dumps(
        {
            "cniVersion": "0.4.0",
            "name": NAME,
            "plugins": [
                {
                    "type": "ptp",
                    "mtu": 1500,
                    "ipMasq": False,
                    "ipam": {
                        "type": "host-local",
                        "dataDir": str(node.run / "addresses"),
                        "ranges": [[{"subnet": node.pod_cidr}]],
                        "routes": [{"dst": "0.0.0.0/0"}],
                    },
                },
                {"type": "portmap", "capabilities": {"portMappings": True}},
            ],
        },
        indent=1,
    )


def ctr(node: Node, *arguments: str | Path) -> str:
    """Run containerd's own client in the kubelet's image namespace."""
    command = ["ctr", "--address", str(node.containerd_socket), "--namespace", "k8s.io"]
    done = subprocess.run(
        [*command, *map(str, arguments)], capture_output=True, text=True, check=False
    )
    if done.returncode:
        output = done.stderr.strip() or done.stdout.strip()
        raise ClusterError(f"`ctr {' '.join(map(str, arguments))}` failed: {output}")
    return done.stdout


def answers(node: Node) -> bool:
    try:
        ctr(node, "version")
    except ClusterError:
        return False
    return True


def daemon_name(node: Node) -> str:
    """The name of a node's containerd among the daemons."""
    return f"containerd-{node.index}"


def root(node: Node) -> Path:
    """Where a node's containerd keeps images and the file systems of containers."""
    return node.state / "containerd"


def start_on(node: Node, binaries: Path) -> None:
    """Start containerd and give it the image of the pause container."""
    network = CONFIG / f"cni-{node.index}"
    network.mkdir(parents=True, exist_ok=True)
    (network / "10-bagpipe.conflist").write_text(pod_network(node))
    node.run.mkdir(parents=True, exist_ok=True)
    path = CONFIG / f"containerd-{node.index}.toml"
    path.write_text(config(node))
    name = daemon_name(node)
    start(name, ["containerd", "--config", path], node=node)
    await_ready(name, lambda: answers(node))
    archive = STATE / "pause.tar"
    oci.write_single_binary(archive, PAUSE, binaries / "pause", "/pause")
    ctr(node, "images", "import", archive)
