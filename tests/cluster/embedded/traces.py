"""What a cluster leaves on the machine, looked for where the kernel and other programs keep it.

`down` asks after its work, so that it can't call a machine clean that is not.
"""

from __future__ import annotations

import shutil
import subprocess
from pathlib import Path

from . import cgroups
from .cleaning import parse_mounts, sandboxes
from .places import NAME, POD_CIDR, RUN, SERVICE_CIDR, STATE

NAMESPACES = Path("/run/netns")
LINKS = Path("/sys/class/net")
RESULTS = Path("/var/lib/cni/results")


def named(folder: Path) -> list[Path]:
    """The files of a folder that have the cluster's name, alone or before a dash."""
    if not folder.is_dir():
        return []
    return sorted(p for p in folder.iterdir() if p.name == NAME or p.name.startswith(f"{NAME}-"))


def rules_of_ours(saved: str) -> list[str]:
    """Lines of `iptables-save` that speak of the cluster's addresses or of its chains."""
    prefixes = [cidr.rsplit(".", 2)[0] + "." for cidr in (POD_CIDR, SERVICE_CIDR)]
    words = [*prefixes, "198.18.", "KUBE-", "CNI-", NAME]
    return [
        line
        for line in saved.splitlines()
        if line.startswith(("-A", ":")) and any(word in line for word in words)
    ]


def firewall() -> str:
    """The rules of the machine's own network namespace; none where there is no iptables."""
    if not shutil.which("iptables-save"):
        return ""
    done = subprocess.run(["iptables-save"], capture_output=True, text=True, check=False)
    return done.stdout


def left() -> list[str]:
    """Whatever is left of a cluster, a phrase each; empty on a clean machine."""
    mounts = parse_mounts(Path("/proc/self/mountinfo").read_text(), [STATE, RUN])
    own_results = [
        path
        for path in (RESULTS.iterdir() if RESULTS.is_dir() else [])
        if path.name.startswith(f"{NAME}-") or of_our_pods(path)
    ]
    return [
        *(f"process {pid}" for pid in sorted(cgroups.members())),
        *(f"control group {tree}" for tree in cgroups.trees()),
        *(f"mount {point}" for point in mounts),
        *(f"network namespace {path.name}" for path in named(NAMESPACES)),
        *(f"link {path.name}" for path in named(LINKS)),
        *(f"note of CNI {path}" for path in own_results),
        *(f"folder {path}" for path in (STATE, RUN) if path.exists()),
        *(f"iptables rule {line}" for line in rules_of_ours(firewall())),
    ]


def of_our_pods(result: Path) -> bool:
    """Whether a CNI result is about a pod of ours: its namespace was below our folder."""
    if not result.name.startswith("cni-loopback-"):
        return False
    return any(RUN in sandbox.parents for sandbox in sandboxes(result.read_text()))
