"""kind's node image, where no registry has one: of Debian's packages and the tests' own Kubernetes.

kind asks little of a node: systemd, containerd with the images of a control plane, kubelet, kubeadm
and kubectl, and in /kind the version and what to apply for a network and a class of storage. Three
things differ from the node that kind publishes: pods are linked by plugins of Debian's in place of
kindnetd (so there is one node), the class offers four folders and makes none, and nothing lowers a
score of the OOM killer.
"""

from __future__ import annotations

import hashlib
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
COMPONENTS = "bagpipe.local/kind-components:1"
LABEL = "io.bagpipe.content"
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
BASE = f"bagpipe.local/kind-base:{hashlib.sha256(' '.join(PACKAGES).encode()).hexdigest()[:16]}"
# By the name of the link a multi-call program knows what it is.
CALLED = ["etcd", "kube-controller-manager", "kube-proxy", "kube-scheduler"]


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


def label(image: str) -> str | None:
    """What an image of the engine's was made of; empty where it does not say, None without it."""
    template = '{{index .Config.Labels "' + LABEL + '"}}'
    asked = ["docker", "image", "inspect", image, "--format", template]
    done = subprocess.run(
        asked, env=engine.environment(), capture_output=True, text=True, check=False
    )
    return None if done.returncode else done.stdout.strip()


def content(*programs: Path) -> str:
    """A hash over all that decides what is in the node's image."""
    digest = hashlib.sha256("\n".join([BASE, *(path.name for path in programs)]).encode())
    for path in sorted([Path(__file__), *FILES.iterdir()]):
        digest.update(f"\n{path.name}\n".encode() + path.read_bytes())
    return digest.hexdigest()[:16]


def make_base(folder: Path) -> None:
    """Debian's packages, made in a namespace that takes the making's mounts with it."""
    tar = folder / "base.tar"
    options = ["--variant=minbase", "--dpkgopt=force-unsafe-io", f"--include={','.join(PACKAGES)}"]
    run("unshare", "--mount", "mmdebstrap", *options, "bookworm", tar)
    run("docker", "import", "--change", 'CMD ["/bin/bash"]', tar, BASE)


def claims() -> str:
    """A default class of a few volumes: folders that all may write to, as those are that kind's
    own class makes.
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
    parts += [
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
        for number in range(CLAIMS)
    ]
    return "\n---\n".join(map(json.dumps, parts))


def images(kubeadm: Path) -> list[str]:
    """The names of a control plane's images, as kubeadm says them."""
    version = f"v{builds.KUBERNETES}"
    return run(kubeadm, "config", "images", "list", "--kubernetes-version", version).split()


def make_components(folder: Path, kubernetes: Path, others: Path, pause: Path) -> None:
    """One image of all components, and one that is the same but for what it starts: pause."""
    context = folder / "components"
    (context / "links").mkdir(parents=True)
    for name in CALLED:
        (context / "links" / name).symlink_to("kube-apiserver")
    for program in (kubernetes / "kubernetes", others / "resolver", pause / "pause"):
        shutil.copy(program, context)
    shutil.copy(FILES / "components.Dockerfile", context / "Dockerfile")
    run("docker", "build", "--network=none", f"--build-arg=BASE={BASE}", "-t", COMPONENTS, context)
    start = context / "pause.Dockerfile"
    start.write_text(f'FROM {COMPONENTS}\nENTRYPOINT ["/pause"]\n')
    run("docker", "build", "-f", start, "-t", f"{COMPONENTS}-pause", context)


def make_node(folder: Path, programs: list[Path], names: list[str], made_of: str) -> None:
    context = folder / "node"
    shutil.copytree(FILES, context)
    shutil.copy(context / "node.Dockerfile", context / "Dockerfile")
    for program in programs:
        shutil.copy(program, context)
    pause = next(name for name in names if "/pause:" in name)
    toml = context / "containerd.toml"
    toml.write_text(toml.read_text().replace("@PAUSE@", pause))
    (context / "version").write_text(f"v{builds.KUBERNETES}")
    (context / "default-storage.yaml").write_text(claims())
    for script in ("entrypoint", "cgroups"):
        (context / script).chmod(0o755)
    for name in names:
        run("docker", "tag", f"{COMPONENTS}-pause" if name == pause else COMPONENTS, name)
    run("docker", "save", "-o", context / "images.tar", *names)
    build = ["docker", "build", "--network=none", f"--build-arg=BASE={BASE}"]
    run(*build, f"--label={LABEL}={made_of}", "-t", IMAGE, context)


def make() -> str:
    """Have the engine hold the node's image, of what is in this checkout; its name."""
    kubernetes, pause = (builds.ensure(builds.named(name)) for name in ("kubernetes", "pause"))
    others = builds.ensure(builds.KUBEADM)
    made_of = content(kubernetes, pause, others)
    if label(IMAGE) == made_of:
        return IMAGE
    with tempfile.TemporaryDirectory(dir=engine.folder()) as place:
        folder = Path(place)
        if label(BASE) is None:
            print("  making the node's base of Debian's packages", flush=True)
            make_base(folder)
        print(f"  making {IMAGE}", flush=True)
        make_components(folder, kubernetes, others, pause)
        programs = [kubernetes / "kubernetes", others / "kubeadm"]
        make_node(folder, programs, images(others / "kubeadm"), made_of)
    return IMAGE
