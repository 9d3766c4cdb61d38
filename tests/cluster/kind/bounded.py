#!/usr/bin/env python3
"""An OCI runtime for engines that ask for more than the machine has: runc, asked for what there is.

Docker's --privileged asks for every capability that the kernel knows, and runc asks the kernel for
each, which refuses what is not in the machine's bounding set (CAP_SYS_RESOURCE often is not in
virtual machines of build services): "unable to apply caps: operation not permitted". Lowering a
score of the OOM killer and raising a limit of resources need CAP_SYS_RESOURCE as well. So this
program takes all that out of the container's configuration, and becomes runc.
"""

from __future__ import annotations

import json
import os
import shutil
import sys
from pathlib import Path
from typing import Any

# By number, as in linux/capability.h.
CAPABILITIES = [
    "CHOWN",
    "DAC_OVERRIDE",
    "DAC_READ_SEARCH",
    "FOWNER",
    "FSETID",
    "KILL",
    "SETGID",
    "SETUID",
    "SETPCAP",
    "LINUX_IMMUTABLE",
    "NET_BIND_SERVICE",
    "NET_BROADCAST",
    "NET_ADMIN",
    "NET_RAW",
    "IPC_LOCK",
    "IPC_OWNER",
    "SYS_MODULE",
    "SYS_RAWIO",
    "SYS_CHROOT",
    "SYS_PTRACE",
    "SYS_PACCT",
    "SYS_ADMIN",
    "SYS_BOOT",
    "SYS_NICE",
    "SYS_RESOURCE",
    "SYS_TIME",
    "SYS_TTY_CONFIG",
    "MKNOD",
    "LEASE",
    "AUDIT_WRITE",
    "AUDIT_CONTROL",
    "SETFCAP",
    "MAC_OVERRIDE",
    "MAC_ADMIN",
    "SYSLOG",
    "WAKE_ALARM",
    "BLOCK_SUSPEND",
    "AUDIT_READ",
    "PERFMON",
    "BPF",
    "CHECKPOINT_RESTORE",
]
RESOURCE = "CAP_SYS_RESOURCE"
# runc's, of which the first in a command line is what it is to do.
VERBS = {"create", "delete", "events", "exec", "kill", "list", "pause", "ps", "resume", "run",
         "start", "state", "update", "features"}  # fmt: skip


def bounding_set(status: str) -> set[str]:
    """The capabilities that a process may have, from the text of its /proc/self/status."""
    mask = int(status.partition("CapBnd:")[2].split()[0], 16)
    return {f"CAP_{name}" for number, name in enumerate(CAPABILITIES) if mask >> number & 1}


def restrict(process: dict[str, Any], bound: set[str]) -> None:
    """Take out of a process' configuration what the bounding set has not."""
    for kind, wanted in (process.get("capabilities") or {}).items():
        process["capabilities"][kind] = [name for name in wanted or [] if name in bound]
    if RESOURCE not in bound:
        process.pop("rlimits", None)
        process["oomScoreAdj"] = max(0, process.get("oomScoreAdj") or 0)


def value(arguments: list[str], *flags: str) -> str | None:
    """What a command line gives to a flag, as one argument or as the next."""
    for at, argument in enumerate(arguments):
        name, equals, text = argument.partition("=")
        if name in flags:
            return text if equals else next(iter(arguments[at + 1 :]), None)
    return None


def rewrite(arguments: list[str], bound: set[str]) -> None:
    """Change the configuration that a command of runc's names, if it names any."""
    verb = next((argument for argument in arguments if argument in VERBS), "")
    if verb in {"create", "run"}:
        path = Path(value(arguments, "--bundle", "-b") or ".") / "config.json"
    elif verb == "exec" and (given := value(arguments, "--process", "-p")):
        path = Path(given)
    else:
        return
    document = json.loads(path.read_text())
    restrict(document.get("process", document), bound)
    path.write_text(json.dumps(document))


def main() -> None:
    arguments = sys.argv[1:]
    rewrite(arguments, bounding_set(Path("/proc/self/status").read_text()))
    runc = shutil.which("runc") or "/usr/sbin/runc"
    os.execv(runc, [runc, *arguments])  # noqa: S606 (no shell is wanted)


if __name__ == "__main__":
    main()
