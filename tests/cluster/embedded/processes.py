"""Daemons that outlive the command that started them, and their certain end.

A daemon is known by its pid *and* the time it started at: after a crash the kernel may give
the pid to a stranger, which must never be signalled.
"""

from __future__ import annotations

import json
import os
import signal
import subprocess
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

from . import cgroups
from .failure import ClusterError, tail, wait_until
from .places import LOGS, PIDS, Node

# The API server would wait a minute for its watchers, who are all going as well.
STOP_SECONDS = 5.0
KILL_SECONDS = 10.0


@dataclass(frozen=True)
class Process:
    """A process of the past or present: `started` is in clock ticks since the boot `boot`."""

    pid: int
    started: int
    boot: str

    @property
    def alive(self) -> bool:
        """Whether this very process runs; one that only awaits its parent's wait is gone."""
        return self.boot == boot() and stat_of(self.pid) == ("running", self.started)

    def send(self, number: signal.Signals) -> None:
        """Signal the process if it is still the same one."""
        if self.alive:
            try:
                os.kill(self.pid, number)
            except ProcessLookupError:
                return  # it ended between the look and the signal, which is what we want


def parse_stat(text: str) -> tuple[str, int]:
    """("running" or "dead", start time) from the text of /proc/<pid>/stat.

    The second field is the program's name in brackets and may itself hold brackets and spaces.
    """
    fields = text[text.rindex(")") + 2 :].split()
    return ("dead" if fields[0] in "ZXx" else "running", int(fields[19]))


def stat_of(pid: int) -> tuple[str, int] | None:
    try:
        return parse_stat(Path(f"/proc/{pid}/stat").read_text())
    except (FileNotFoundError, ProcessLookupError):
        return None


def boot() -> str:
    """The kernel's id of this run of the machine, another one after each restart."""
    return Path("/proc/sys/kernel/random/boot_id").read_text().strip()


def remember(name: str, pid: int) -> Process:
    """Write the pid file of a process that we just started."""
    found = stat_of(pid)
    if found is None:
        raise ClusterError(f"{name} ended at once.\n{tail(log_of(name))}")
    PIDS.mkdir(parents=True, exist_ok=True)
    temporary = PIDS / f".{name}"
    process = Process(pid, found[1], boot())
    temporary.write_text(json.dumps(asdict(process)))
    temporary.rename(PIDS / name)
    return process


def recall(name: str) -> Process | None:
    """The process of a pid file, alive or not; None when there is no readable one."""
    try:
        kept = json.loads((PIDS / name).read_text())
        return Process(int(kept["pid"]), int(kept["started"]), str(kept["boot"]))
    except (FileNotFoundError, ValueError, KeyError):
        return None


def log_of(name: str) -> Path:
    return LOGS / f"{name}.log"


def start(
    name: str,
    command: Sequence[str | Path],
    *,
    node: Node | None = None,
    environment: Mapping[str, str] | None = None,
) -> Process:
    """Start a daemon in its own session, in the daemons' control group and, if `node` is
    given, in that node's network namespace. Its output goes to its log.
    """
    LOGS.mkdir(parents=True, exist_ok=True)
    inside = ["nsenter", f"--net={node.namespace}"] if node else []
    # The shell joins the control group before it becomes the daemon, so that no child of the
    # daemon can be born outside; every step is an exec, so the pid stays the same.
    join = 'for group in $GROUPS_TO_JOIN; do echo $$ > "$group/cgroup.procs"; done; exec "$@"'
    groups = " ".join(str(group) for group in cgroups.of_daemons())
    with log_of(name).open("ab") as log:
        started = subprocess.Popen(
            ["sh", "-c", join, "sh", *inside, *map(str, command)],
            stdin=subprocess.DEVNULL,
            stdout=log,
            stderr=log,
            start_new_session=True,
            cwd="/",
            env={**os.environ, **(environment or {}), "GROUPS_TO_JOIN": groups},
        )
    return remember(name, started.pid)


def demand_all_alive() -> None:
    """Raise ClusterError for a daemon that has ended, with the end of its log."""
    for name in names():
        process = recall(name)
        if process is None or not process.alive:
            raise ClusterError(
                f"{name} has ended. The last lines of {log_of(name)}:\n{tail(log_of(name))}"
            )


def await_ready(name: str, check: Callable[[], bool], *, seconds: float = 60.0) -> None:
    """Wait for `check`; fail at once if any daemon ends, for they all need each other."""

    def ready() -> bool:
        demand_all_alive()
        return check()

    wait_until(f"{name} becoming ready", ready, seconds=seconds, log=log_of(name))


def names() -> list[str]:
    """The names of all daemons that have a pid file."""
    return sorted(p.name for p in PIDS.glob("[!.]*")) if PIDS.is_dir() else []


def stop(names: list[str]) -> None:
    """End daemons together: SIGTERM, after STOP_SECONDS SIGKILL; wait until they are gone."""
    running = {name: process for name in names if (process := recall(name))}
    for process in running.values():
        process.send(signal.SIGTERM)
    for name, process in running.items():
        _await_end(name, process)
    for name in names:
        (PIDS / name).unlink(missing_ok=True)


def _await_end(name: str, process: Process) -> None:
    def gone() -> bool:
        return not process.alive

    try:
        wait_until(f"the end of {name}", gone, seconds=STOP_SECONDS)
    except ClusterError:
        process.send(signal.SIGKILL)
        wait_until(f"the end of {name}", gone, seconds=KILL_SECONDS)
