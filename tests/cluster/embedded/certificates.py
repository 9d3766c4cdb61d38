"""The cluster's certificates: openssl makes new ones for each cluster."""

from __future__ import annotations

import base64
import json
import os
import subprocess
from dataclasses import dataclass
from pathlib import Path

from .failure import ClusterError
from .places import API_SERVER, API_SERVICE, DOMAIN, FIRST, KUBECONFIG, NAME, PKI, Node

DAYS = "365"


@dataclass(frozen=True)
class Identity:
    """Who a certificate speaks for: the user and the group of RBAC."""

    file: str
    user: str
    group: str = ""
    names: tuple[str, ...] = ()

    @property
    def subject(self) -> str:
        return (f"/O={self.group}" if self.group else "") + f"/CN={self.user}"


def kubelet_identity(node: Node) -> Identity:
    return Identity(
        f"kubelet-{node.index}",
        f"system:node:{node.name}",
        "system:nodes",
        (f"DNS:{node.name}", f"IP:{node.address}"),
    )


def identities(nodes: list[Node]) -> list[Identity]:
    """Everyone who serves or calls the API of a cluster of these nodes."""
    api = (
        "DNS:kubernetes",
        "DNS:kubernetes.default",
        "DNS:kubernetes.default.svc",
        f"DNS:kubernetes.default.svc.{DOMAIN}",
        "DNS:localhost",
        "IP:127.0.0.1",
        f"IP:{API_SERVICE}",
        f"IP:{FIRST.address}",
    )
    return [
        Identity("apiserver", "kube-apiserver", names=api),
        # kubelets let the API server do everything (logs, exec), so it comes as an administrator.
        Identity("apiserver-kubelet", "kube-apiserver-kubelet-client", "system:masters"),
        Identity("controller-manager", "system:kube-controller-manager"),
        Identity("scheduler", "system:kube-scheduler"),
        Identity("proxy", "system:kube-proxy"),
        Identity("admin", "kubernetes-admin", "system:masters"),
        *map(kubelet_identity, nodes),
    ]


def openssl(*arguments: str | Path) -> None:
    done = subprocess.run(
        ["openssl", *map(str, arguments)], capture_output=True, text=True, check=False
    )
    if done.returncode:
        raise ClusterError(f"openssl {arguments[0]} failed: {done.stderr.strip()}")


def key(file: str) -> Path:
    path = PKI / f"{file}.key"
    openssl("ecparam", "-name", "prime256v1", "-genkey", "-noout", "-out", path)
    path.chmod(0o600)
    return path


def issue(who: Identity) -> None:
    """Make a key and have the cluster's authority sign its certificate."""
    request, extensions = PKI / f"{who.file}.csr", PKI / f"{who.file}.ext"
    openssl("req", "-new", "-key", key(who.file), "-subj", who.subject, "-out", request)
    lines = ["keyUsage=digitalSignature", "extendedKeyUsage=clientAuth,serverAuth"]
    if who.names:
        lines.append("subjectAltName=" + ",".join(who.names))
    extensions.write_text("\n".join(lines) + "\n")
    openssl(
        *("x509", "-req", "-in", request, "-CA", PKI / "ca.crt", "-CAkey", PKI / "ca.key"),
        *("-CAcreateserial", "-days", DAYS, "-extfile", extensions),
        *("-out", PKI / f"{who.file}.crt"),
    )
    request.unlink()
    extensions.unlink()


def kubeconfig(file: str) -> str:
    """A kubeconfig, as JSON (which is YAML), that carries its certificates in itself."""

    def data(name: str) -> str:
        return base64.b64encode((PKI / name).read_bytes()).decode()

    cluster = {"server": API_SERVER, "certificate-authority-data": data("ca.crt")}
    user = {
        "client-certificate-data": data(f"{file}.crt"),
        "client-key-data": data(f"{file}.key"),
    }
    return json.dumps(
        {
            "apiVersion": "v1",
            "kind": "Config",
            "clusters": [{"name": NAME, "cluster": cluster}],
            "users": [{"name": file, "user": user}],
            "contexts": [{"name": NAME, "context": {"cluster": NAME, "user": file}}],
            "current-context": NAME,
        },
        indent=1,
    )


def write_private(path: Path, text: str) -> None:
    descriptor = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_TRUNC, 0o600)
    with os.fdopen(descriptor, "w") as file:
        file.write(text)


def create(nodes: list[Node]) -> None:
    """Make the authority, all certificates, all kubeconfigs and the service accounts' key."""
    PKI.mkdir(parents=True, exist_ok=True)
    PKI.chmod(0o700)
    openssl(
        *("req", "-x509", "-new", "-key", key("ca"), "-subj", f"/CN={NAME}-ca"),
        *("-addext", "keyUsage=critical,keyCertSign,cRLSign", "-days", DAYS),
        *("-out", PKI / "ca.crt"),
    )
    for who in identities(nodes):
        issue(who)
        write_private(PKI / f"{who.file}.kubeconfig", kubeconfig(who.file))
    openssl("ec", "-in", key("service-accounts"), "-pubout", "-out", PKI / "service-accounts.pub")
    write_private(KUBECONFIG, kubeconfig("admin"))
    if os.environ.get("SUDO_UID"):
        os.chown(KUBECONFIG, int(os.environ["SUDO_UID"]), int(os.environ["SUDO_GID"]))
