"""kind's node image, where no registry has one: of Debian's packages and the tests' own Kubernetes.

kind asks little of a node: systemd, containerd with the images of a control plane, kubelet, kubeadm
and kubectl, and in /kind the version and what to apply for a network and a class of storage. Three
things differ from the node that kind publishes: pods are linked by plugins of Debian's in place of
kindnetd (so there is one node), the class offers four folders that are there in place of making them,
and nothing lowers a score of the OOM killer.
"""

from __future__ import annotations

import json
import shutil
import subprocess
import tempfile
from pathlib import Path

from embedded import builds
from embedded.failure import ClusterError

from . import engine

FILES = Path(__file__).with_name("files")
IMAGE = f"bagpipe.local/kind-node:{builds.KUBERNETES}"
BASE = "bagpipe.local/kind-base:1"
COMPONENTS = "bagpipe.local/kind-components:1"
SECONDS = 1200.0
CLAIMS = 4
PACKAGES = [
    "ca-certificates",
    "conntrack",
    "containerd",
    "containernetworking-plugins",
    "dbus",
    "ethtool",
    "iproute2",
    "iptables",
    "kmod",
    "mount",
    "procps",
    "runc",
    "socat",
    "systemd",
    "systemd-sysv",
    "util-linux",
]
CALLED = ["etcd", "kube-controller-manager", "kube-scheduler"]


def run(*command: str | Path, folder: Path | None = None) -> str:
    done = subprocess.run(
        [*map(str, command)],
        cwd=folder,
        env={**engine.environment(), "DOCKER_BUILDKIT": "0"},
        capture_output=True,
        text=True,
        timeout=SECONDS,
        check=False,
    )
    if done.returncode:
        last = "\n".join((done.stdout + done.stderr).splitlines()[-15:])
        raise ClusterError(f"`{' '.join(map(str, command))[:200]}` failed:\n{last}")
    return done.stdout


def has(image: str) -> bool:
    asked = ["docker", "image", "inspect", image]
    done = subprocess.run(asked, env=engine.environment(), capture_output=True, check=False)
    return done.returncode == 0


def make_base(folder: Path) -> None:
    """Debian's packages, made in a namespace that takes the making's mounts with it."""
    tar = folder / "base.tar"
    options = ["--variant=minbase", "--dpkgopt=force-unsafe-io", f"--include={','.join(PACKAGES)}"]
    run("unshare", "--mount", "mmdebstrap", *options, "bookworm", tar)
    run("docker", "import", "--change", 'CMD ["/bin/bash"]', tar, BASE)


def claims() -> str:
    """A default class of as many volumes as the demonstration has claims, and some: folders that all
    may write to, as in those that kind's own class makes.
    """
    default = {"storageclass.kubernetes.io/is-default-class": "true"}
    parts: list[dict[str, object]] = [
        {
            "apiVersion": "storage.k8s.io/v1",
            "kind": "StorageClass",
            "metadata": {"name": "standard", "annotations": default},
            "provisioner": "kubernetes.io/no-provisioner",
            "volumeBindingMode": "WaitForFirstConsumer",
        }
    ]
    for number in range(CLAIMS):
        parts.append(
            {
                "apiVersion": "v1",
                "kind": "PersistentVolume",
                "metadata": {"name": f"claim-{number}"},
                "spec": {
                    "storageClassName": "standard",
                    "capacity": {"storage": "10Gi"},
                    "accessModes": ["ReadWriteOnce"],
                    "persistentVolumeReclaimPolicy": "Retain",
                    "hostPath": {"path": f"/var/claims/{number}", "type": "Directory"},
                },
            }
        )
    return "\n---\n".join(map(json.dumps, parts))


def images(kubeadm: Path) -> list[str]:
    """The names of a control plane's images, as kubeadm says them."""
    version = f"v{builds.KUBERNETES}"
    return run(kubeadm, "config", "images", "list", "--kubernetes-version", version).split()


def make_components(folder: Path, kubernetes: Path, others: Path, names: list[str]) -> None:
    """One image of all components, saved under each of their names; pause is an image of its own."""
    context = folder / "components"
    (context / "links").mkdir(parents=True)
    for name in CALLED:
        (context / "links" / name).symlink_to("kube-apiserver")
    (context / "links" / "kube-proxy").symlink_to("kube-apiserver")
    shutil.copy(kubernetes, context / "kubernetes")
    shutil.copy(others / "resolver", context / "resolver")
    shutil.copy(builds.ensure(builds.named("pause")) / "pause", context / "pause")
    dockerfile = FILES / "components.Dockerfile"
    build = ["docker", "build", "--network=none", f"--build-arg=BASE={BASE}", "-f", dockerfile]
    run(*build, "-t", COMPONENTS, context)
    for name in names:
        change = ["--label=of=pause"] if "/pause:" in name else []
        if change:
            text = f'FROM {COMPONENTS}\nENTRYPOINT ["/pause"]\n'
            (context / "pause.Dockerfile").write_text(text)
            run("docker", "build", "-f", context / "pause.Dockerfile", "-t", name, context)
        else:
            run("docker", "tag", COMPONENTS, name)


def make() -> str:
    """Have the engine hold the node's image; its name."""
    kubernetes = builds.ensure(builds.named("kubernetes")) / "kubernetes"
    others = builds.ensure(builds.KUBEADM)
    names = images(others / "kubeadm")
    pause = next(name for name in names if "/pause:" in name)
    with tempfile.TemporaryDirectory(dir=engine.folder()) as place:
        folder = Path(place)
        if not has(BASE):
            make_base(folder)
        make_components(folder, kubernetes, others, names)
        context = folder / "node"
        shutil.copytree(FILES, context)
        toml = context / "containerd.toml"
        toml.write_text(toml.read_text().replace("@PAUSE@", pause))
        shutil.copy(kubernetes, context / "kubernetes")
        shutil.copy(others / "kubeadm", context / "kubeadm")
        (context / "version").write_text(f"v{builds.KUBERNETES}")
        (context / "default-storage.yaml").write_text(claims())
        for script in ("entrypoint", "cgroups"):
            (context / script).chmod(0o755)
        run("docker", "save", "-o", context / "images.tar", *names)
        build = ["docker", "build", "--network=none", f"--build-arg=BASE={BASE}"]
        run(*build, "-f", context / "node.Dockerfile", "-t", IMAGE, context)
    return IMAGE
