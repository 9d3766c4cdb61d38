"""Run tests while their processes and threads stand still at random, and name those that fail.

    python -m tests.stalls.run [WORD...]            the agent's tests, those with one of the words
    python -m tests.stalls.run --pytest FILE...     tests of Python; with options: -- FILE -k WORD

A test that assumes that two processes keep pace, or that something is done within half a second,
fails on a busy machine now and then. Here each test runs by itself, and again and again one process
below it, or one thread of it, stands still for a while. Who fails has its seed beside it: with that
seed the pauses have the same lengths, though not the same victims at the same moments.
"""

import argparse
import contextlib
import json
import os
import random
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor, as_completed
from dataclasses import dataclass
from pathlib import Path

from tests.processes import PROC
from tests.stalls.freeze import (
    descendants,
    freeze_child,
    freeze_process,
    freeze_threads,
    threads,
)

ROOT = Path(__file__).parents[2]
AGENT = ROOT / "images/agent"
# A test that is not over by then hangs: stalls make none of them take a minute longer.
DEADLINE = 300.0
# Of all stalls, those of a thread of the test itself, where it has processes below it.
OF_THREADS = 0.35
# Of a failed test's output and of its stalls, the last ones are of interest.
LINES, STALLS = 25, 30


@dataclass(frozen=True)
class Command:
    """What runs one test, and where."""

    test: str
    words: tuple[str, ...]
    folder: Path


@dataclass(frozen=True)
class Pauses:
    """How long who stands still, and how long all run between two stalls on average, in seconds."""

    shortest: float
    longest: float
    between: float


@dataclass(frozen=True)
class Stall:
    """One stall: how long all run before it, how long it lasts, and which of those there are.

    `whom` from 0 to below 1 is a place among them, in the order of their numbers.
    """

    after: float
    seconds: float
    of_a_thread: bool
    whom: float


@dataclass(frozen=True)
class Outcome:
    """How a test ended; its stalls name who stood still, for how long, and until when."""

    test: str
    seed: int
    passed: bool
    seconds: float
    stalls: list[str]
    output: str

    def __str__(self) -> str:
        """A line, and for one that failed what it wrote last and who stood still."""
        word = "ok" if self.passed else "FAILED"
        line = (
            f"{word} {self.test} (seed {self.seed}, {self.seconds:.1f} s,"
            f" {len(self.stalls)} stalls)"
        )
        if self.passed:
            return line
        output = self.output.splitlines()[-LINES:]
        return "\n    ".join([line, *output, "stalls:", *self.stalls[-STALLS:]])


def main() -> int:
    given = _arguments()
    found = of_pytest(given.words) if given.pytest else of_agent(given.words)
    if not found:
        print("No test has that name.")
        return 2
    plan = random.Random(given.seed)  # noqa: S311 - a plan, no secret
    runs = [(each, plan.randrange(10**6)) for _ in range(given.rounds) for each in found]
    plan.shuffle(runs)
    pauses = Pauses(given.shortest, given.longest, given.between)
    print(f"{len(runs)} runs, {given.at_once} at once, seed {given.seed}", flush=True)
    failed = 0
    with ThreadPoolExecutor(given.at_once) as pool:
        started = [pool.submit(stalled, command, seed, pauses) for command, seed in runs]
        for outcome in (each.result() for each in as_completed(started)):
            failed += not outcome.passed
            print(outcome, flush=True)
    print(f"{failed} of {len(runs)} failed")
    return min(failed, 1)


def stalls(seed: int, pauses: Pauses) -> Iterator[Stall]:
    """One stall after another, without end; the same for the same seed."""
    chance = random.Random(seed)  # noqa: S311 - as above
    while True:
        yield Stall(
            chance.uniform(0, 2 * pauses.between),
            chance.uniform(pauses.shortest, pauses.longest),
            chance.random() < OF_THREADS,
            chance.random(),
        )


def stalled(command: Command, seed: int, pauses: Pauses, deadline: float = DEADLINE) -> Outcome:
    """Run a test in a session of its own, with stalls until it ends or its deadline is over."""
    began, done = time.monotonic(), []
    with tempfile.TemporaryFile("w+", errors="replace") as output:
        running = subprocess.Popen(
            command.words,
            cwd=command.folder,
            env=os.environ | {"CARGO_MANIFEST_DIR": str(command.folder), "RUST_BACKTRACE": "0"},
            stdin=subprocess.DEVNULL,
            stdout=output,
            stderr=subprocess.STDOUT,
            start_new_session=True,
        )
        try:
            for stall in stalls(seed, pauses):
                left = began + deadline - time.monotonic()
                if left <= 0 or _has_ended(running, min(stall.after, left)):
                    break
                if who := _freeze(running.pid, stall):
                    at = time.monotonic() - began
                    done.append(f"{who} for {stall.seconds:.2f} s until {at:.2f} s")
            hangs = running.poll() is None
        finally:
            _end(running)
        output.seek(0)
        text = output.read()
    if hangs:
        text += f"\nIt was not over after {deadline:.0f} s.\n"
    seconds = time.monotonic() - began
    return Outcome(command.test, seed, running.returncode == 0, seconds, done, text)


def _has_ended(running: subprocess.Popen[bytes], within: float) -> bool:
    try:
        running.wait(within)
    except subprocess.TimeoutExpired:
        return False
    return True


def _freeze(test: int, stall: Stall) -> str | None:
    """Who stood still: a process below the test, or one of its own threads, or else it."""
    below = [] if stall.of_a_thread else descendants(test)
    its_threads = [] if below else threads(test)
    these = below or its_threads or [test]
    who = these[int(stall.whom * len(these))]
    name = f"{'thread' if its_threads else 'process'} {_name(who)}"
    if below:
        froze = freeze_process(who, stall.seconds)
    elif its_threads:
        froze = freeze_threads([who], stall.seconds)
    else:
        froze = freeze_child(test, stall.seconds)
    return name if froze else None


def _name(who: int) -> str:
    """The end of a process's command line, or a thread's name."""
    try:
        name = (PROC / str(who) / "comm").read_text(errors="replace").strip()
        words = (PROC / str(who) / "cmdline").read_text(errors="replace").replace("\0", " ")
    except OSError:
        return str(who)
    return f"{name} ({words.strip()[-70:]})"


def _end(running: subprocess.Popen[bytes]) -> None:
    """End a test that is still there, and all below it."""
    if running.poll() is None:
        for one in [running.pid, *descendants(running.pid)]:
            with contextlib.suppress(ProcessLookupError):
                os.kill(one, signal.SIGKILL)
    running.wait()


def of_agent(words: Sequence[str]) -> list[Command]:
    """The agent's tests whose CRATE/FILE::NAME has one of the words, or all; built before."""
    command = [
        "cargo",
        "test",
        "--locked",
        "--workspace",
        "--no-run",
        "--quiet",
        "--message-format=json",
    ]
    built = subprocess.run(command, cwd=AGENT, check=True, stdout=subprocess.PIPE, text=True)
    found = []
    for program, folder, crate in programs(built.stdout.splitlines()):
        list_them = [program, "--list"]
        listed = subprocess.run(
            list_them, cwd=folder, check=True, stdout=subprocess.PIPE, text=True
        )
        for name in names(listed.stdout):
            whole = f"{crate}::{name}"
            if not words or any(word in whole for word in words):
                options = ("--exact", name, "--nocapture", "--test-threads", "1")
                found.append(Command(whole, (program, *options), folder))
    return found


def names(listed: str) -> list[str]:
    """The tests in what a program of tests prints for --list."""
    end = ": test"
    return [line.removesuffix(end) for line in listed.splitlines() if line.endswith(end)]


def programs(messages: Sequence[str]) -> Iterator[tuple[str, Path, str]]:
    """What cargo has built tests into: each with its crate's folder, and CRATE/FILE."""
    for message in map(json.loads, messages):
        if message.get("executable") and message["profile"]["test"]:
            folder = Path(message["manifest_path"]).parent
            yield message["executable"], folder, f"{folder.name}/{message['target']['name']}"


def of_pytest(words: Sequence[str]) -> list[Command]:
    """Tests of Python: what pytest finds for these files and options."""
    pytest = (sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", "-n", "0")
    command = [*pytest, "--collect-only", *words]
    found = subprocess.run(command, cwd=ROOT, check=False, stdout=subprocess.PIPE, text=True)
    tests = [line for line in found.stdout.splitlines() if "::" in line]
    return [Command(name, (*pytest, name), ROOT) for name in tests]


def _arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("words", nargs="*", metavar="WORD")
    parser.add_argument("--pytest", action="store_true", help="tests of Python, each WORD a file")
    parser.add_argument("--seed", type=int, help="a number for the same pauses")
    parser.add_argument("--rounds", type=int, default=1, help="how often each test runs")
    parser.add_argument("--at-once", type=int, default=os.cpu_count() or 1)
    parser.add_argument("--shortest", type=float, default=0.03, metavar="SECONDS")
    parser.add_argument("--longest", type=float, default=0.4, metavar="SECONDS")
    parser.add_argument("--between", type=float, default=0.4, metavar="SECONDS")
    given = parser.parse_args()
    if given.seed is None:
        given.seed = random.SystemRandom().randrange(10**6)
    if not 0 <= given.shortest <= given.longest:
        parser.error("--shortest is at most --longest, and neither is below 0")
    return given


if __name__ == "__main__":
    sys.exit(main())
