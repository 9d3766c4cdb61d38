"""The cluster's control groups: a label on every process that belongs to it.

Daemons and shims are in <hierarchy>/bagpipe/daemons, pods in <hierarchy>/bagpipe/<node>/...
Who is below `bagpipe` is ours, whatever became of pid files; nobody else ever is.
"""

from __future__ import annotations

import os
import signal
from pathlib import Path

from .failure import wait_until
from .places import CGROUP, CGROUP_ROOT, Node


def unified() -> bool:
    """Whether the machine has control groups of version 2 only."""
    return (CGROUP_ROOT / "cgroup.controllers").exists()


def hierarchies() -> list[Path]:
    """The roots in which a group has to be made: one in version 2, one a controller in 1."""
    if unified():
        return [CGROUP_ROOT]
    found = [p for p in sorted(CGROUP_ROOT.iterdir()) if (p / "cgroup.procs").exists()]
    # cpu and cpu,cpuacct may be the same hierarchy under two names.
    return list({p.resolve(): p for p in found}.values())


def of_daemons() -> list[Path]:
    """The groups a daemon joins: one hierarchy is enough to find it again."""
    roots = hierarchies()
    by_name = {p.name: p for p in roots}
    root = by_name.get("pids") or by_name.get("systemd") or roots[0]
    return [root / CGROUP / "daemons"]


def create(node: Node) -> None:
    """Make the groups of the daemons and of a node; the kubelet refuses to make its parent."""
    for group in of_daemons():
        group.mkdir(parents=True, exist_ok=True)
    for root in hierarchies():
        path = root / node.cgroup
        if unified():
            _delegate(root, node.cgroup)
        path.mkdir(parents=True, exist_ok=True)
        _inherit_cpuset(root, node.cgroup)


def _delegate(root: Path, path: str) -> None:
    """Hand every controller down to the group: version 2 gives a child none by itself."""
    group = root
    for part in path.split("/"):
        enabled = " ".join("+" + c for c in (group / "cgroup.controllers").read_text().split())
        (group / "cgroup.subtree_control").write_text(enabled)
        group = group / part
        group.mkdir(exist_ok=True)


def _inherit_cpuset(root: Path, path: str) -> None:
    """A new cpuset of version 1 has no processor and no memory and can hold no process."""
    if unified():
        return
    group = root
    for part in path.split("/"):
        for name in ("cpuset.cpus", "cpuset.mems"):
            if (group / part / name).exists() and not (group / part / name).read_text().strip():
                (group / part / name).write_text((group / name).read_text())
        group = group / part


def trees() -> list[Path]:
    """Our top group in each hierarchy where it exists."""
    roots = [*hierarchies(), CGROUP_ROOT / "unified"]
    return [root / CGROUP for root in roots if (root / CGROUP).is_dir()]


def members() -> set[int]:
    """The pids of every process in our groups."""
    found: set[int] = set()
    for tree in trees():
        for listing in tree.rglob("cgroup.procs"):
            try:
                found.update(int(line) for line in listing.read_text().split())
            except OSError:
                continue  # the group went away, or is threaded and has no such list
    return found - {0}


def kill_all(seconds: float = 20.0) -> None:
    """SIGKILL everything in our groups until nothing is left."""

    def emptied() -> bool:
        left = members()
        for pid in left:
            try:
                os.kill(pid, signal.SIGKILL)
            except ProcessLookupError:
                continue
        return not left

    wait_until("the end of all processes in the cluster's control groups", emptied, seconds=seconds)


def remove(seconds: float = 10.0) -> None:
    """Remove our groups, deepest first; the kernel frees a group a moment after its end."""

    def removed() -> bool:
        for tree in trees():
            groups = [p for p in tree.rglob("*") if p.is_dir()]
            for group in [*sorted(groups, key=lambda p: -len(p.parts)), tree]:
                try:
                    group.rmdir()
                except OSError:
                    continue
        return not trees()

    wait_until("the removal of the cluster's control groups", removed, seconds=seconds)
