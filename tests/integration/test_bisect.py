"""`bagpipe bisect` in a real repository, under a real `git bisect run`, over a real agent."""

import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import pytest

from tests.integration.laptop import MARK, RUN_SECONDS, STEP_SECONDS, Laptop

pytestmark = pytest.mark.integration

# The case 1 is what is looked at; 0 is errored in all commits, and nobody asks for it.
PROGRAM = """
import os, sys, time
from bagpipe import binpipe
for record in binpipe.read():
    if record.read() == b"0":
        sys.exit(3)
    {line}
    binpipe.write(b"done", name="answer")
"""
GOOD = "pass"
BAD = "os.kill(os.getpid(), 11)"
# Errored: what it writes is no frame.
MUTE = "os.write(binpipe._descriptors[1], b'no frame' * 9)"
HANGS = "time.sleep(600)"
# Each run does what the one before it did not.
FLAKES = """\
seen = os.environ["BISECT_SEEN"]
    if os.path.exists(seen):
        os.unlink(seen)
        os.kill(os.getpid(), 11)
    open(seen, "w").close()"""


@dataclass
class Repository:
    """A repository whose commits have one program each, and beside it a job that runs it."""

    folder: Path
    laptop: Laptop
    job: Path

    def commit(self, line: str) -> str:
        """A commit whose program does so; its name."""
        (self.folder / "stack.py").write_text(PROGRAM.format(line=line))
        (self.folder / "version").write_text(str(time.monotonic_ns()))
        self.git("add", ".")
        self.git("commit", "--quiet", "--message", line[:20])
        return self.git("rev-parse", "HEAD").strip()

    def git(self, *words: str) -> str:
        """What git writes; fails where git does."""
        done = self.run("git", *words)
        assert done.returncode == 0, done.stdout + done.stderr
        return done.stdout

    def run(self, *words: str) -> "subprocess.CompletedProcess[str]":
        return subprocess.run(
            words, cwd=self.folder, env=self.environment(), timeout=RUN_SECONDS,
            capture_output=True, text=True, check=False,
        )  # fmt: skip

    def environment(self) -> dict[str, str]:
        scratch = self.laptop.folder / "tmp"
        scratch.mkdir(exist_ok=True)
        person = dict.fromkeys(("GIT_AUTHOR_NAME", "GIT_COMMITTER_NAME"), "a")
        person |= dict.fromkeys(("GIT_AUTHOR_EMAIL", "GIT_COMMITTER_EMAIL"), "a@example.org")
        own = {"GIT_CONFIG_GLOBAL": os.devnull, "GIT_CONFIG_SYSTEM": os.devnull, **person}
        own |= {"TMPDIR": str(scratch), MARK: self.laptop.mark}
        return os.environ | own | {"BISECT_SEEN": str(self.laptop.folder / "seen")}

    def step(self, *words: str) -> list[str]:
        """The command line of a step that looks at the case 1."""
        volume = f"recordings={self.laptop.folder / 'recordings'}"
        given = ["--case", "1*", "--volume", volume, "--agent", str(self.laptop.agent), *words]
        return [sys.executable, "-m", "bagpipe.cli", "bisect", str(self.job), *given]

    def first_bad(self, good: str, bad: str, *words: str) -> "subprocess.CompletedProcess[str]":
        """A whole search, as people start it."""
        self.git("bisect", "start", bad, good)
        return self.run("git", "bisect", "run", *self.step(*words))

    def tried(self) -> dict[str, str]:
        """What the search has called each commit that it looked at."""
        lines = [line.split() for line in self.git("bisect", "log").splitlines()]
        return {words[-1]: words[2] for words in lines if words[:2] == ["git", "bisect"]
                and words[2] in ("good", "bad", "skip")}  # fmt: skip


@pytest.fixture
def repository(tmp_path: Path, agent_binary: Path) -> Iterator[Repository]:
    laptop = Laptop(tmp_path, agent_binary)
    for folder in ("recordings", "repository"):
        (tmp_path / folder).mkdir()
    for number in range(2):
        (tmp_path / f"recordings/{number}.bin").write_text(str(number))
    command = [sys.executable, str(tmp_path / "repository/stack.py")]
    spec = {
        "source": {"files": ["pvc://recordings/*.bin"]},
        "stack": {"engine": "exec", "image": "any", "command": command},
        # Its verdict is Invalid whatever happens: what a step is asked is no verdict.
        "quarantine": [{"cases": "*", "reason": "it flakes", "until": "2026-12-31"}],
        "output": {"uri": "pvc://results/r"},
    }
    made = Repository(tmp_path / "repository", laptop, laptop.manifest("lane", spec))
    made.git("init", "--quiet")
    yield made
    laptop.await_nothing_left()


def test_git_finds_the_first_bad_commit_past_one_that_can_t_be_judged(
    repository: Repository,
) -> None:
    commits = [repository.commit(line) for line in (GOOD, GOOD, GOOD, MUTE, GOOD, BAD, BAD, BAD)]
    found = repository.first_bad(commits[0], commits[-1])
    assert found.returncode == 0, found.stdout + found.stderr
    assert f"{commits[5]} is the first bad commit" in found.stdout
    tried = repository.tried()
    assert tried[commits[5]] == "bad"
    assert tried.get(commits[3], "skip") == "skip"
    kept = repository.folder / "bagpipe-results/lane-bisect"
    assert (kept / commits[5][:12] / "round-0/report.html").exists()
    assert "StackCrashed" in found.stderr


def test_a_commit_that_flakes_is_passed_over_and_git_says_what_is_left(
    repository: Repository,
) -> None:
    commits = [repository.commit(line) for line in (GOOD, FLAKES, BAD)]
    found = repository.first_bad(commits[0], commits[-1], "--rounds", "2")
    assert "it flakes here" in found.stderr
    assert repository.tried() == {commits[1]: "skip"}
    assert "first bad commit could be any of" in found.stdout


def test_a_mistake_stops_the_search_and_names_no_commit(repository: Repository) -> None:
    commits = [repository.commit(line) for line in (GOOD, GOOD, BAD)]
    found = repository.first_bad(commits[0], commits[-1], "--round", "two")
    assert found.returncode != 0
    assert "first bad commit" not in found.stdout
    assert commits[1] not in repository.tried()


def test_a_run_that_takes_too_long_is_ended_and_says_nothing(repository: Repository) -> None:
    repository.commit(HANGS)
    done = repository.run(*repository.step("--timeout", "6s"))
    assert done.returncode == 125, done.stderr
    assert "not ended within 6 s" in done.stderr
    repository.laptop.await_nothing_left()


def test_an_interruption_stops_git_and_leaves_nothing(repository: Repository) -> None:
    repository.commit(HANGS)
    process = subprocess.Popen(
        repository.step(), cwd=repository.folder, env=repository.environment(),
        text=True, stdout=subprocess.PIPE, stderr=subprocess.PIPE,
    )  # fmt: skip
    deadline, pause = time.monotonic() + STEP_SECONDS, threading.Event()
    while not any("stack.py" in line for line in repository.laptop.left_over()):
        assert process.poll() is None
        assert time.monotonic() < deadline
        pause.wait(0.1)
    process.send_signal(signal.SIGINT)
    _, errors = process.communicate(timeout=STEP_SECONDS)
    assert process.returncode == 130, errors
    repository.laptop.await_nothing_left()
