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
    stores,
    tools,
    traces,
    volumes,
)
from .api import Api
from .failure import ClusterError, wait_until
from .places import KUBECONFIG, LOCK, LOGS, NODE_COUNT, RECORD, STATE, nodes
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
        stores,
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
    for each in nodes():
        if not api.node_ready(each.name):
            found.append(f"Node {each.name} is not ready.")
        if network.cut_off(each):
            found.append(f"Node {each.name} is cut off from the others.")
    if not addons.dns_ready():
        found.append("CoreDNS is not ready.")
    return found


def demand_count(count: int) -> None:
    """Raise ClusterError if a cluster of another number of nodes is running."""
    there = len(nodes())
    running = any(process.alive for name in names() if (process := recall(name)))
    if running and count != there:
        raise ClusterError(
            f"A cluster of NODES={there} is running and NODES={count} is asked for. Nodes can't "
            "be added or taken away: `make down` removes the cluster and all in it, then try again."
        )


def up(count: int | None = None) -> None:
    """Start the cluster unless this very one is up and healthy.

    `count` is the number of nodes: None asks for as many as there are, or one where there are
    none. Raises ClusterError if another number of nodes is running.
    """
    with locked():
        began = time.monotonic()
        count = count or len(nodes())
        demand_count(count)
        binaries = builds.binaries()
        tools.link()
        if recorded() == fingerprint(binaries):
            found = troubles()
            if not found:
                print(f"  the cluster is up; KUBECONFIG={KUBECONFIG}")
                return
            print("  " + " ".join(found) + " Starting again.", flush=True)
        cleaning.down()
        start(binaries, count)
        took = time.monotonic() - began
        print(f"  the cluster is up after {took:.1f} s; KUBECONFIG={KUBECONFIG}")


def start(binaries: Path, count: int) -> None:
    STATE.mkdir(parents=True)
    STATE.chmod(0o755)
    NODE_COUNT.write_text(f"{count}\n")
    certificates.create(nodes())
    for each in nodes():
        cgroups.create(each)
        network.create(each)
    network.connect(nodes())
    if count > 1:
        stores.share(nodes(), binaries)
    control_plane.start_all(binaries, count)
    for each in nodes():
        node.start_node(each, binaries, count)
    for each in nodes():
        node.await_node(each)
    addons.start_all(binaries)
    processes.demand_all_alive()
    RECORD.write_text(json.dumps({"fingerprint": fingerprint(binaries)}))


def down() -> None:
    with locked():
        began = time.monotonic()
        cleaning.down()
        left = traces.left()
        if left:
            listed = "\n".join(f"  - {trace}" for trace in left)
            raise ClusterError(f"something of the cluster is left:\n{listed}")
        print(f"  nothing of the cluster is left ({time.monotonic() - began:.1f} s)")
        LOCK.unlink(missing_ok=True)


def status() -> None:
    found = troubles()
    if found:
        raise ClusterError(" ".join(found))
    print(f"The cluster is healthy; KUBECONFIG={KUBECONFIG}")
    for each in nodes():
        print(f"  node {each.name}: {each.address}, pods {each.pod_cidr}")
    for name in names():
        process = recall(name)
        print(f"  {name}: pid {process.pid if process else '-'}")
