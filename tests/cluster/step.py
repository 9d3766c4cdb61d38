"""Run one step of make: say what it does, how long it took, and what to do when it fails.

python3 tests/cluster/step.py WHAT [--if-it-fails ADVICE] [--output-at-its-end] -- COMMAND...
python3 tests/cluster/step.py --summary

A step that runs beside another one may keep its output until its end, so that both can be read.
Each says how long it took the last time, or on the machine of FIRST where this is its first.

Each step adds a line to the file that BAGPIPE_STEPS names, if it does; the summary has the longest
first, each with the seconds that it had a processor (of what it waited for: no server that stays).
"""

from __future__ import annotations

import contextlib
import json
import os
import resource
import subprocess
import sys
import time
from pathlib import Path

# Seconds of the long steps with empty caches, beside each other, on two processors (November 2026).
FIRST = {
    "Building Kubernetes": 564,
    "Building images": 342,
    "Compiling the agent's tests": 280,
    "Building the agent": 164,
    "Making .venv from uv.lock": 51,
    "Running the demonstration's job without Kubernetes": 51,
    "Loading images": 34,
    "Running the demonstration": 33,
}


def colour(code: str, text: str) -> str:
    return f"\033[{code}m{text}\033[0m" if sys.stdout.isatty() else text


def duration(seconds: float) -> str:
    """1.2 s, 34 s or 5 min 06 s."""
    if seconds < 10:
        return f"{seconds:.1f} s"
    minutes, rest = divmod(round(seconds), 60)
    return f"{minutes} min {rest:02d} s" if minutes else f"{rest} s"


def expectation(what: str, kept: Path) -> str:
    """How long a step may take, in words; empty where it is not known, or not worth a word."""
    try:
        last = float((kept / file_name(what)).read_text())
    except (OSError, ValueError):
        first = FIRST.get(what)
        return f" (the first time: {duration(first)} on two processors)" if first else ""
    return f" (the last time: {duration(last)})" if last >= 10 else ""


def remember(what: str, seconds: float, kept: Path) -> None:
    """Keeps what a step took for the next time; that it can't be kept is no fault of the step."""
    partly = kept / f"{file_name(what)}.{os.getpid()}"
    with contextlib.suppress(OSError):
        kept.mkdir(parents=True, exist_ok=True)
        partly.write_text(f"{seconds:.1f}")
        partly.replace(kept / file_name(what))


def file_name(what: str) -> str:
    return "".join(letter if letter.isalnum() else "-" for letter in what)


def split(arguments: list[str]) -> tuple[str, str, bool, list[str]]:
    """(what, advice, whether its output comes at its end, command) of a command line."""
    at = arguments.index("--")
    words, command = arguments[:at], arguments[at + 1 :]
    advice = words[words.index("--if-it-fails") + 1] if "--if-it-fails" in words else ""
    return words[0], advice, "--output-at-its-end" in words, command


def run(command: list[str], output: Path | None) -> int:
    """The command's status; its output stands in a file until its end, if there is one.

    The file has a name and stays where the step itself is killed. Raises OSError where the command
    can't be run.
    """
    if output is None:
        return subprocess.run(command, check=False).returncode
    output.parent.mkdir(parents=True, exist_ok=True)
    print(f"    its output comes at its end, and stands in {output} until then", flush=True)
    with output.open("wb") as file:
        try:
            return subprocess.run(command, check=False, stdout=file, stderr=file).returncode
        finally:
            sys.stdout.buffer.write(output.read_bytes())
            sys.stdout.flush()


def processor_seconds() -> float:
    """Of all processes that this one waited for, and those that they waited for."""
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


def record(what: str, seconds: float, processor: float) -> None:
    """Keeps a step's times for the summary."""
    if path := os.environ.get("BAGPIPE_STEPS"):
        step = {"what": what, "ended": time.time(), "seconds": seconds, "processor": processor}
        with Path(path).open("a") as file:
            file.write(json.dumps(step) + "\n")


def summary(lines: list[str]) -> str:
    """The steps that took a second or more, the longest first, and all of them: one after the
    other, and as long as it took, since some ran beside each other.
    """
    steps = [json.loads(line) for line in lines]
    if not steps:  # of another make, which has begun since
        return ""
    longest = sorted(steps, key=lambda step: -step["seconds"])
    rows = [
        (step["what"], step["seconds"], step["processor"])
        for step in longest
        if step["seconds"] >= 1
    ]
    processor = sum(step["processor"] for step in steps)
    rows.append(("all steps, each by itself", sum(step["seconds"] for step in steps), processor))
    begun = min(step["ended"] - step["seconds"] for step in steps)
    rows.append(("from the first to the last", max(s["ended"] for s in steps) - begun, processor))
    lines = [f"{duration(took):>15}  {duration(used):>15}  {what}" for what, took, used in rows]
    return "\n".join([f"{'took':>15}  {'of a processor':>15}  step", *lines])


def main() -> int:
    if sys.argv[1:] == ["--summary"]:
        print(summary(Path(os.environ["BAGPIPE_STEPS"]).read_text().splitlines()))
        return 0
    what, advice, at_its_end, command = split(sys.argv[1:])
    kept = Path(os.environ.get("BAGPIPE_CACHE") or Path.home() / ".cache/bagpipe") / "steps"
    output = kept / f"{file_name(what)}.log" if at_its_end else None
    print(colour("1", f"==> {what}{expectation(what, kept)}"), flush=True)
    began = time.monotonic()
    try:
        status = run(command, output)
    except KeyboardInterrupt:
        print(f"\n<== interrupted: {what}. It can be run again.", file=sys.stderr)
        return 130
    except OSError as error:
        print(f"{command[0]} can't be run: {error}", file=sys.stderr)
        status = 127
    seconds = time.monotonic() - began
    took = duration(seconds)
    record(what, seconds, processor_seconds())
    if status:
        # Shown by a signal's number, a child's end is a negative status.
        message = f"<== FAILED after {took}: {what} (status {status})."
        print(colour("31;1", message), file=sys.stderr)
        print(f"    {advice or 'Its last lines are above.'}", file=sys.stderr)
        return status if 0 < status < 256 else 1
    remember(what, seconds, kept)
    print(colour("32", f"<== {what}: {took}"), flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())
