"""How many processes the kernel of this machine has ended for lack of memory.

With cgroup v2 the kubelet has it end a whole container, and the agent with the stack, so that
nobody in there can report why. The count is of the node, also within a container, and needs no
right.
"""

from pathlib import Path

VMSTAT = Path("/proc/vmstat")


def memory_kills() -> int | None:
    """Since the machine was started; None where the kernel (before 4.13) does not count them."""
    try:
        lines = VMSTAT.read_text().splitlines()
    except OSError:
        return None
    for line in lines:
        name, _, number = line.partition(" ")
        if name == "oom_kill" and number.isdecimal():
            return int(number)
    return None


def kills_since(before: int | None) -> int:
    """How many since there were `before`; 0 where that is not known."""
    now = memory_kills()
    return 0 if before is None or now is None else max(0, now - before)
