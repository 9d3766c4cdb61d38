"""Processes and threads, as the kernel shows them (proc(5))."""

from pathlib import Path

PROC = Path("/proc")


def below(pid: int) -> list[int]:
    """The processes below one, at any depth, each before those below it."""
    found = []
    for task in (PROC / str(pid) / "task").glob("*/children"):
        try:
            children = [int(child) for child in task.read_text().split()]
        except OSError:
            continue
        for child in children:
            found += [child, *below(child)]
    return found


def state(pid: int, thread: int | None = None) -> str | None:
    """The letter of a process's, or of a thread's, state; None where it is gone."""
    try:
        task = PROC / str(pid) / "task" / str(thread or pid)
        # The name of a program, in brackets, may have blanks and brackets, or be no text.
        return (task / "stat").read_text(errors="replace").rpartition(")")[2].split()[0]
    except OSError:
        return None
