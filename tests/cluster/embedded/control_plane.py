"""etcd, the API server, the controller manager and the scheduler, on the first node."""

from __future__ import annotations

from pathlib import Path

from .api import Api
from .places import (
    API_PORT,
    DOMAIN,
    FIRST,
    NAME,
    PKI,
    POD_CIDR,
    SERVICE_CIDR,
    STATE,
)
from .processes import await_ready, start

ETCD = "http://127.0.0.1:2379"
# Several nodes are for tests of their loss: Kubernetes itself would wait for 50 seconds.
SILENCE_SECONDS = 20
# Go collects garbage each time the heap has doubled, which is a fifth of the processor's time of a
# small cluster; below the limit it may grow fivefold.
SELDOM_COLLECTED = {"GOGC": "400", "GOMEMLIMIT": "1536MiB"}


def etcd_flags() -> list[str]:
    return [
        f"--data-dir={STATE / 'etcd'}",
        f"--listen-client-urls={ETCD}",
        f"--advertise-client-urls={ETCD}",
        "--listen-peer-urls=http://127.0.0.1:2380",
        # The cluster is thrown away as a whole: what a power cut loses nobody misses.
        "--unsafe-no-fsync",
        "--snapshot-count=5000",
        "--log-level=warn",
    ]


def apiserver_flags() -> list[str]:
    return [
        f"--etcd-servers={ETCD}",
        f"--advertise-address={FIRST.address}",
        f"--secure-port={API_PORT}",
        f"--service-cluster-ip-range={SERVICE_CIDR}",
        "--authorization-mode=Node,RBAC",
        "--enable-admission-plugins=NodeRestriction",
        "--allow-privileged=true",
        f"--client-ca-file={PKI / 'ca.crt'}",
        f"--tls-cert-file={PKI / 'apiserver.crt'}",
        f"--tls-private-key-file={PKI / 'apiserver.key'}",
        f"--cert-dir={PKI}",
        f"--kubelet-certificate-authority={PKI / 'ca.crt'}",
        f"--kubelet-client-certificate={PKI / 'apiserver-kubelet.crt'}",
        f"--kubelet-client-key={PKI / 'apiserver-kubelet.key'}",
        # Node names are in no DNS, so logs and exec have to go to addresses.
        "--kubelet-preferred-address-types=InternalIP",
        f"--service-account-issuer=https://kubernetes.default.svc.{DOMAIN}",
        f"--service-account-key-file={PKI / 'service-accounts.pub'}",
        f"--service-account-signing-key-file={PKI / 'service-accounts.key'}",
        "--profiling=false",
        # Ending at once matters more here than draining clients for a minute.
        "--shutdown-delay-duration=0s",
    ]


def controller_manager_flags(count: int) -> list[str]:
    """`count` is the number of nodes."""
    kubeconfig = PKI / "controller-manager.kubeconfig"
    # One node can't be cut off: silence means a busy machine there and is tolerated as usual.
    grace = [f"--node-monitor-grace-period={SILENCE_SECONDS}s"] if count > 1 else []
    return [
        *grace,
        f"--kubeconfig={kubeconfig}",
        f"--authentication-kubeconfig={kubeconfig}",
        f"--authorization-kubeconfig={kubeconfig}",
        f"--cluster-name={NAME}",
        f"--cluster-cidr={POD_CIDR}",
        f"--service-cluster-ip-range={SERVICE_CIDR}",
        f"--root-ca-file={PKI / 'ca.crt'}",
        f"--service-account-private-key-file={PKI / 'service-accounts.key'}",
        f"--cert-dir={PKI}",
        "--use-service-account-credentials=true",
        "--leader-elect=false",
        "--profiling=false",
    ]


def scheduler_flags() -> list[str]:
    kubeconfig = PKI / "scheduler.kubeconfig"
    return [
        f"--kubeconfig={kubeconfig}",
        f"--authentication-kubeconfig={kubeconfig}",
        f"--authorization-kubeconfig={kubeconfig}",
        f"--cert-dir={PKI}",
        "--leader-elect=false",
        "--profiling=false",
    ]


def start_all(binaries: Path, count: int) -> None:
    def begin(name: str, flags: list[str]) -> None:
        start(name, [binaries / name, *flags], node=FIRST, environment=SELDOM_COLLECTED)

    begin("etcd", etcd_flags())
    begin("kube-apiserver", apiserver_flags())
    api = Api()
    await_ready("kube-apiserver", api.healthy, seconds=120)
    for name, flags in (
        ("kube-controller-manager", controller_manager_flags(count)),
        ("kube-scheduler", scheduler_flags()),
    ):
        begin(name, flags)
