"""Up, down and status of the one cluster."""

from __future__ import annotations

import contextlib
import fcntl
import hashlib
import json
import os
import time
from collections.abc import Iterator
from pathlib import Path

from . import (
    addons,
    builds,
    certificates,
    cgroups,
    cleaning,
    containerd,
    control_plane,
    network,
    node,
    places,
    processes,
    tools,
    volumes,
)
from .api import Api
from .failure import ClusterError, wait_until
from .places import KUBECONFIG, LOCK, LOGS, RECORD, STATE, nodes
from .processes import names, recall

LOCK_SECONDS = 1800.0  # as long as another's first `up` may take to build


@contextlib.contextmanager
def locked() -> Iterator[None]:
    """One command at a time changes the cluster. The kernel drops a dead holder's lock."""
    LOCK.parent.mkdir(parents=True, exist_ok=True)
    with contextlib.ExitStack() as held:

        def taken() -> bool:
            file = held.enter_context(LOCK.open("w"))
            try:
                fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
                # `down` removes the file: only a lock on the one that is there now counts.
                return os.path.samestat(os.fstat(file.fileno()), LOCK.stat())
            except (BlockingIOError, FileNotFoundError):
                held.close()
                return False

        wait_until(f"another command's release of {LOCK}", taken, seconds=LOCK_SECONDS)
        yield


def fingerprint(binaries: Path) -> str:
    """What decides how a cluster runs: its programs and the code that starts them."""
    digest = hashlib.sha256(str(binaries).encode())
    for module in (
        addons,
        certificates,
        cgroups,
        containerd,
        control_plane,
        network,
        node,
        places,
        processes,
        volumes,
    ):
        digest.update(Path(str(module.__file__)).read_bytes())
    return digest.hexdigest()


def recorded() -> str:
    """The fingerprint of the cluster that came up completely, or nothing."""
    try:
        return str(json.loads(RECORD.read_text())["fingerprint"])
    except (FileNotFoundError, ValueError, KeyError):
        return ""


def troubles() -> list[str]:
    """What is wrong with the running cluster, a sentence each; empty when it is healthy."""
    if not recorded():
        return ["No cluster is up."]
    found = []
    for name in names():
        process = recall(name)
        if process is None or not process.alive:
            found.append(f"{name} has ended; its log is {LOGS / name}.log.")
    api = Api()
    if not api.healthy():
        return [*found, "The API server is not ready."]
    found += [f"Node {n.name} is not ready." for n in nodes() if not api.node_ready(n.name)]
    if not addons.dns_ready():
        found.append("CoreDNS is not ready.")
    return found


def up() -> None:
    """Start the cluster unless this very one is up and healthy."""
    with locked():
        began = time.monotonic()
        binaries = builds.binaries()
        tools.link()
        if recorded() == fingerprint(binaries):
            found = troubles()
            if not found:
                print(f"  the cluster is up; KUBECONFIG={KUBECONFIG}")
                return
            print("  " + " ".join(found) + " Starting anew.", flush=True)
        cleaning.down()
        start(binaries)
        took = time.monotonic() - began
        print(f"  the cluster is up after {took:.1f} s; KUBECONFIG={KUBECONFIG}")


def start(binaries: Path) -> None:
    STATE.mkdir(parents=True)
    STATE.chmod(0o755)
    certificates.create()
    for each in nodes():
        cgroups.create(each)
        network.create(each)
    control_plane.start_all(binaries)
    for each in nodes():
        node.start_node(each, binaries)
    addons.start_all(binaries)
    processes.demand_all_alive()
    RECORD.write_text(json.dumps({"fingerprint": fingerprint(binaries)}))


def down() -> None:
    with locked():
        began = time.monotonic()
        cleaning.down()
        print(f"  nothing of the cluster is left ({time.monotonic() - began:.1f} s)")
        LOCK.unlink(missing_ok=True)


def status() -> None:
    found = troubles()
    if found:
        raise ClusterError(" ".join(found))
    print(f"The cluster is healthy; KUBECONFIG={KUBECONFIG}")
    for name in names():
        process = recall(name)
        print(f"  {name}: pid {process.pid if process else '-'}")
