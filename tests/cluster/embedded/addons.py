"""What every cluster has beyond its core: DNS and a default class of storage."""

from __future__ import annotations

import sys
import urllib.error
import urllib.request
from pathlib import Path

from . import volumes
from .api import Api, Object
from .places import CONFIG, DNS_SERVICE, DOMAIN, FIRST, PKI, sources
from .processes import await_ready, start

DNS_HEALTH_PORT = 8181


def corefile() -> str:
    """Names of the cluster only: there is no way out to ask anyone for others."""
    return f"""{DOMAIN}:53 in-addr.arpa:53 ip6.arpa:53 {{
    errors
    ready {FIRST.address}:{DNS_HEALTH_PORT}
    kubernetes {DOMAIN} in-addr.arpa ip6.arpa {{
        kubeconfig {PKI}/admin.kubeconfig
        pods insecure
        ttl 5
    }}
    cache 5 {{
        disable denial
    }}
}}

.:53 {{
    errors
    template ANY ANY {{
        rcode NXDOMAIN
    }}
}}
"""


def dns_objects() -> list[tuple[str, Object]]:
    """The Service kube-dns and the address behind it: CoreDNS runs as a daemon of the node,
    because an image for it would be one more thing to build before the cluster can start.
    """
    base = "/namespaces/kube-system"
    labels = {"k8s-app": "kube-dns", "kubernetes.io/name": "CoreDNS"}
    ports = [{"name": "dns", "port": 53, "protocol": "UDP"}]
    ports.append({"name": "dns-tcp", "port": 53, "protocol": "TCP"})
    service = {
        "apiVersion": "v1",
        "kind": "Service",
        "metadata": {"name": "kube-dns", "namespace": "kube-system", "labels": labels},
        "spec": {"clusterIP": DNS_SERVICE, "ports": ports},
    }
    endpoints = {
        "apiVersion": "discovery.k8s.io/v1",
        "kind": "EndpointSlice",
        "metadata": {
            "name": "kube-dns",
            "namespace": "kube-system",
            "labels": {"kubernetes.io/service-name": "kube-dns"},
        },
        "addressType": "IPv4",
        "ports": ports,
        "endpoints": [{"addresses": [FIRST.address], "conditions": {"ready": True}}],
    }
    return [
        (f"/api/v1{base}/services", service),
        (f"/apis/discovery.k8s.io/v1{base}/endpointslices", endpoints),
    ]


def dns_ready() -> bool:
    try:
        with urllib.request.urlopen(
            f"http://{FIRST.address}:{DNS_HEALTH_PORT}/ready", timeout=2
        ) as answer:
            return bool(answer.status == 200)
    except (OSError, urllib.error.URLError):
        return False


def start_all(binaries: Path) -> None:
    api = Api()
    path = CONFIG / "Corefile"
    path.write_text(corefile())
    start("coredns", [binaries / "coredns", "-conf", path], node=FIRST)
    for collection, body in dns_objects():
        api.create(collection, body)
    api.create("/apis/storage.k8s.io/v1/storageclasses", volumes.storage_class())
    program = sources() / "embedded"
    start(
        "volumes",
        [sys.executable, "-m", "embedded.volumes"],
        environment={"PYTHONPATH": str(program.parent), "PYTHONUNBUFFERED": "1"},
    )
    await_ready("coredns", dns_ready)
