"""What runs on every node: containerd, the kubelet and kube-proxy."""

from __future__ import annotations

import json
from pathlib import Path

from . import containerd
from .api import Api, Object
from .certificates import kubelet_identity
from .control_plane import SILENCE_SECONDS
from .places import CONFIG, DNS_SERVICE, DOMAIN, FIRST, PKI, POD_CIDR, Node
from .processes import await_ready, start

MAX_PODS = 200  # of the 253 addresses in a node's /24


def machine_memory(meminfo: str) -> int:
    """The machine's memory in KiB from the text of /proc/meminfo."""
    return int(meminfo.partition("MemTotal:")[2].split()[0])


def several_nodes(count: int, memory: int) -> Object:
    """A kubelet's configuration where the machine of `memory` KiB carries `count` of them.

    Each would offer all of the machine. Memory is shared out, so that the nodes together never
    promise more than there is; processors are not, for they can be shared while in use.
    """
    if count == 1:
        return {}
    return {
        "systemReserved": {"memory": f"{memory - memory // count}Ki"},
        # The lease is renewed four times in its time: often enough for SILENCE_SECONDS.
        "nodeLeaseDurationSeconds": SILENCE_SECONDS,
    }


def kubelet_config(node: Node, count: int, memory: int) -> Object:
    """KubeletConfiguration, for a small machine whose disk and memory others use too.

    `count` is the number of nodes, `memory` the machine's in KiB.
    """
    identity = kubelet_identity(node)
    return {
        "apiVersion": "kubelet.config.k8s.io/v1beta1",
        "kind": "KubeletConfiguration",
        "authentication": {
            "anonymous": {"enabled": False},
            "webhook": {"enabled": True},
            "x509": {"clientCAFile": str(PKI / "ca.crt")},
        },
        "authorization": {"mode": "Webhook"},
        "tlsCertFile": str(PKI / f"{identity.file}.crt"),
        "tlsPrivateKeyFile": str(PKI / f"{identity.file}.key"),
        "containerRuntimeEndpoint": f"unix://{node.containerd_socket}",
        "cgroupDriver": "cgroupfs",
        "cgroupRoot": "/" + node.cgroup,
        "failCgroupV1": False,
        "failSwapOn": False,
        # Lowering one's own score needs CAP_SYS_RESOURCE, which machines like CI's may lack.
        "oomScoreAdj": 0,
        "maxPods": MAX_PODS,
        "clusterDNS": [DNS_SERVICE],
        "clusterDomain": DOMAIN,
        "resolvConf": str(CONFIG / "resolv.conf"),
        "podLogsDir": str(node.state / "pod-logs"),
        "volumePluginDir": str(node.state / "volume-plugins"),
        # No registry could give an image back that was collected as garbage.
        "imageGCHighThresholdPercent": 100,
        "imageGCLowThresholdPercent": 99,
        "evictionHard": {
            "memory.available": "100Mi",
            "nodefs.available": "1%",
            "nodefs.inodesFree": "1%",
            "imagefs.available": "1%",
        },
        "serializeImagePulls": False,
        "syncFrequency": "10s",
        "nodeStatusUpdateFrequency": "5s",
        "registerNode": True,
        "featureGates": {},
        **several_nodes(count, memory),
    }


def kubelet_flags(node: Node) -> list[str]:
    identity = kubelet_identity(node)
    return [
        f"--config={CONFIG / f'kubelet-{node.index}.json'}",
        f"--kubeconfig={PKI / f'{identity.file}.kubeconfig'}",
        f"--root-dir={node.state / 'kubelet'}",
        f"--cert-dir={node.state / 'kubelet-pki'}",
        f"--hostname-override={node.name}",
        f"--node-ip={node.address}",
    ]


def proxy_config(node: Node) -> Object:
    return {
        "apiVersion": "kubeproxy.config.k8s.io/v1alpha1",
        "kind": "KubeProxyConfiguration",
        "mode": "iptables",
        "clientConnection": {"kubeconfig": str(PKI / "proxy.kubeconfig")},
        "hostnameOverride": node.name,
        "clusterCIDR": POD_CIDR,
        "iptables": {"minSyncPeriod": "100ms", "syncPeriod": "30s"},
        # These are settings of the machine, not of the namespace: leave them alone.
        "conntrack": {
            "maxPerCore": 0,
            "min": 0,
            "tcpCloseWaitTimeout": "0s",
            "tcpEstablishedTimeout": "0s",
        },
    }


def kubelet_name(node: Node) -> str:
    """The name of a node's kubelet among the daemons."""
    return f"kubelet-{node.index}"


def start_kubelet(node: Node, binaries: Path) -> None:
    """Start the kubelet of a node whose configuration is written."""
    start(kubelet_name(node), [binaries / "kubelet", *kubelet_flags(node)], node=node)


def start_node(node: Node, binaries: Path, count: int) -> None:
    """Start the daemons of one of `count` nodes; `await_node` waits for them."""
    CONFIG.mkdir(parents=True, exist_ok=True)
    node.state.mkdir(parents=True, exist_ok=True)
    (CONFIG / "resolv.conf").write_text(f"nameserver {FIRST.address}\n")
    kubelet, proxy = CONFIG / f"kubelet-{node.index}.json", CONFIG / f"proxy-{node.index}.json"
    memory = machine_memory(Path("/proc/meminfo").read_text())
    kubelet.write_text(json.dumps(kubelet_config(node, count, memory), indent=1))
    proxy.write_text(json.dumps(proxy_config(node), indent=1))
    containerd.start_on(node, binaries)
    start_kubelet(node, binaries)
    start(f"kube-proxy-{node.index}", [binaries / "kube-proxy", f"--config={proxy}"], node=node)


def await_node(node: Node) -> None:
    """Wait until the API server calls the node ready."""
    api = Api()
    await_ready(kubelet_name(node), lambda: api.node_ready(node.name), seconds=90)
