"""What the machine must have: named all at once before anything else happens.

`check` looks for what can't be installed here (a newer Go, another file system) and says it all
in one message; `install` then gets from apt what is missing.
"""

from __future__ import annotations

import fcntl
import os
import re
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

from .failure import ClusterError
from .places import STATE, cache

Version = tuple[int, ...]
APT_SECONDS = 1500.0
SERVICE_POLICY = Path("/usr/sbin/policy-rc.d")
# For images and caches, and once those are there for what a cluster writes.
FREE_GIB, FREE_GIB_WHEN_BUILT = 15, 4

PACKAGES = {
    "cluster": [
        "conntrack",
        "containerd",
        "containernetworking-plugins",
        "iproute2",
        "iptables",
        "openssl",
        "runc",
        "util-linux",
    ],
    "images": ["buildah", "gcc", "libc6-dev", "mmdebstrap"],
    # A real browser for the tests of the report.
    "browser": ["chromium", "chromium-driver"],
    "tools": ["dpkg-dev", "prometheus", "python3-venv", "shellcheck"],
    # What runs the demonstration's job without Kubernetes.
    "laptop": ["openjdk-17-jre-headless", "python3-rosmaster", "ros-robot-state-publisher"],
    "integration": [
        "cyclonedds-dev",
        "g++",
        "libfastrtps-dev",
        # With it any program can load a librcl that was built for Python.
        "libpython3.11",
        "libroscpp-dev",
        "librosbag-dev",
        "libsensor-msgs-dev",
        "libstd-msgs-dev",
        "libtf2-msgs-dev",
        "make",
        "maven",
        "python3-geometry-msgs",
        "python3-nav-msgs",
        "python3-rosbag",
        "python3-rosnode",
        "python3-rosparam",
        "python3-rospy",
        "python3-rostopic",
        "python3-sensor-msgs",
        "python3-std-msgs",
        "python3-tf2-msgs",
    ],
}
# What releases for machines of the other architecture are compiled, linked and run with, on each.
CROSS = {
    "x86_64": ["gcc-aarch64-linux-gnu", "libc6-dev-arm64-cross", "qemu-user-static"],
    "aarch64": ["gcc-x86-64-linux-gnu", "libc6-dev-amd64-cross", "qemu-user-static"],
}
# Only for who asks for them by name: a Docker engine is much to have on a machine.
BY_NAME = {"kind": ["docker.io"], "cross": CROSS.get(os.uname().machine, [])}


def version_in(text: str) -> Version:
    """The first dotted number in a text, such as 1.26.8 in `go version go1.26.8 linux`."""
    found = re.search(r"\d+(?:\.\d+)+", text)
    return tuple(int(part) for part in found[0].split(".")) if found else ()


def dotted(version: Version) -> str:
    return ".".join(map(str, version))


def tool(name: str, command: list[str], least: Version, what_for: str) -> str | None:
    """A sentence on what is wrong with a language's tool, or None."""
    if not shutil.which(command[0]):
        return f"{name} is missing: {dotted(least)} or newer is needed to {what_for}."
    done = subprocess.run(command, capture_output=True, text=True, timeout=60, check=False)
    found = version_in(done.stdout + done.stderr)
    if found < least:
        version = dotted(found) or "of an unknown version"
        return f"{name} is {version}, and {what_for} needs {dotted(least)} or newer."
    return None


def fifo_works(folder: Path) -> bool:
    """Whether a named pipe made in the folder carries bytes."""
    with tempfile.TemporaryDirectory(dir=folder) as place:
        fifo = Path(place) / "fifo"
        try:
            os.mkfifo(fifo)
            reader = os.open(fifo, os.O_RDONLY | os.O_NONBLOCK)
            writer = os.open(fifo, os.O_WRONLY | os.O_NONBLOCK)
        except OSError:
            return False
        try:
            return os.write(writer, b"x") == 1 and os.read(reader, 1) == b"x"
        except OSError:
            return False
        finally:
            os.close(reader)
            os.close(writer)


def overlay_works(folder: Path) -> bool:
    """Whether the kernel mounts an overlay with its layers in the folder."""
    with tempfile.TemporaryDirectory(dir=folder) as place:
        parts = {name: Path(place) / name for name in ("lower", "upper", "work", "merged")}
        for part in parts.values():
            part.mkdir()
        (parts["lower"] / "file").write_text("x")
        options = ",".join(f"{n}dir={parts[n]}" for n in ("lower", "upper", "work"))
        command = ["mount", "-t", "overlay", "overlay", "-o", options, str(parts["merged"])]
        if subprocess.run(command, capture_output=True, check=False).returncode:
            return False
        try:
            return (parts["merged"] / "file").read_text() == "x"
        finally:
            subprocess.run(["umount", str(parts["merged"])], capture_output=True, check=False)


def disk(folder: Path) -> str | None:
    if int(os.environ.get("MAKELEVEL", "0")) > 1:
        return None  # a make that was called by one that has looked, and has built since
    free = shutil.disk_usage(folder).free / 2**30
    needed = FREE_GIB_WHEN_BUILT if built() else FREE_GIB
    if free >= needed:
        return None
    return f"{folder} has {free:.1f} GiB free; {needed} GiB are needed for images and caches."


def built() -> bool:
    """Whether the demonstration's images are in the cache, of this checkout or an earlier one."""
    # Five, of which one may be about to be replaced.
    return len(list((cache() / "images").glob("*.oci.json"))) >= 4


def machine(*folders: Path) -> list[str]:
    """What is wrong with the machine itself, a sentence each."""
    if sys.platform != "linux":
        return ["This is not Linux: the cluster is made of Linux's namespaces."]
    found = []
    if os.geteuid():
        found.append("You are not root: namespaces, mounts and containers need it (try sudo).")
    if not shutil.which("apt-get"):
        found.append("There is no apt-get: the packages come from Debian 12.")
    for folder in folders:
        if not os.access(folder, os.W_OK):
            found.append(f"{folder} can't be written.")
            continue
        if not os.geteuid() and not overlay_works(folder):
            found.append(f"The file system of {folder} can't carry overlay mounts for containers.")
        if not fifo_works(folder):
            found.append(f"The file system of {folder} can't carry named pipes (FIFOs).")
        found += filter(None, [disk(folder)])
    return found


def languages() -> list[str]:
    """What is wrong with the languages' tools. Java is not here: apt has it."""
    checks: list[Callable[[], str | None]] = [
        lambda: tool(
            "Go", ["go", "version"], (1, 25), "build Kubernetes 1.34 and the tests' S3 server"
        ),
        lambda: tool("Rust", ["cargo", "--version"], (1, 88), "build the agent"),
        lambda: tool("Python", ["python3", "--version"], (3, 11), "run Bagpipe"),
    ]
    return [message for message in (check() for check in checks) if message]


def old_java() -> str | None:
    """Java may be missing (apt brings 17) but an older one first on PATH would be in the way."""
    if not shutil.which("java"):
        return None
    return tool("Java", ["java", "-version"], (17,), "run Spark in the tests")


def missing(packages: list[str]) -> list[str]:
    """Those packages that dpkg does not have installed."""
    command = ["dpkg-query", "--show", "--showformat", "${db:Status-Abbrev} ${Package}\n"]
    done = subprocess.run([*command, *packages], capture_output=True, text=True, check=False)
    installed = {
        line.split()[-1] for line in done.stdout.splitlines() if line.startswith(("ii", "hi"))
    }
    return [p for p in packages if p not in installed]


def apt(*arguments: str) -> None:
    environment = {**os.environ, "DEBIAN_FRONTEND": "noninteractive"}
    command = ["apt-get", "-o", "DPkg::Lock::Timeout=300", "-o", "Acquire::Retries=3", *arguments]
    done = subprocess.run(
        command,
        env=environment,
        stdin=subprocess.DEVNULL,
        capture_output=True,
        text=True,
        timeout=APT_SECONDS,
        check=False,
    )
    if done.returncode:
        last = "\n".join((done.stdout + done.stderr).splitlines()[-10:])
        raise ClusterError(f"`{' '.join(command)}` failed; its last lines:\n{last}")


@contextmanager
def services_held(policy: Path = SERVICE_POLICY) -> Iterator[None]:
    """Keeps Debian from starting what it installs: the tests start their own Prometheus.

    A policy that the machine has already is left as it is.
    """
    if policy.exists():
        yield
        return
    policy.write_text("#!/bin/sh\nexit 101\n")
    policy.chmod(0o755)
    try:
        yield
    finally:
        policy.unlink()


@contextmanager
def apt_to_itself() -> Iterator[None]:
    """One after the other: the second would find the first one's services no longer held."""
    with (cache() / "apt.lock").open("w") as file:
        fcntl.flock(file, fcntl.LOCK_EX)  # as long as apt takes, which has a deadline
        yield


def install(packages: list[str]) -> None:
    """Install what is missing, after one look at what the archive has now."""
    if not missing(packages):
        return
    with apt_to_itself():
        wanted = missing(packages)
        if not wanted:  # by now
            return
        print(f"  installing with apt: {' '.join(wanted)}", flush=True)
        apt("update")
        with services_held():
            apt("install", "--yes", "--no-install-recommends", *wanted)
    left = missing(packages)
    if left:
        raise ClusterError(f"apt did not install {', '.join(left)}.")


def check() -> None:
    """Say all at once what the machine lacks that no package brings. Raises ClusterError."""
    cache().mkdir(parents=True, exist_ok=True)
    wrong = [*machine(cache(), STATE.parent), *languages(), *filter(None, [old_java()])]
    if wrong:
        listed = "\n".join(f"  - {sentence}" for sentence in wrong)
        raise ClusterError(f"this machine lacks what can't be installed for you:\n{listed}")


def run(sets: list[str]) -> None:
    """Check everything, then install the sets of packages, all of them if none is named."""
    known = {**PACKAGES, **BY_NAME}
    unknown = set(sets) - set(known)
    if unknown:
        raise ClusterError(f"There is no set {', '.join(unknown)}; sets are {', '.join(known)}.")
    check()
    install([package for name in sets or PACKAGES for package in known[name]])
    print("  the machine has what is needed", flush=True)
