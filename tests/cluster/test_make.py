"""The Makefile's graph: what is asked for has all that it needs, from an empty folder."""

from __future__ import annotations

import os
import re
import subprocess
import tomllib
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
CRATES = ROOT / "images/agent/crates"


def made(*arguments: str) -> str:
    """What make would do, as text."""
    environment = {
        name: os.environ[name] for name in ("PATH", "HOME", "AT_ITS_END") if name in os.environ
    }
    command = ["make", "--dry-run", "--always-make", *arguments]
    done = subprocess.run(
        command, cwd=ROOT, env=environment, capture_output=True, text=True, timeout=60, check=True
    )
    return done.stdout


def test_the_first_verdict_has_what_reads_recordings() -> None:
    # The demonstration on an empty machine ended here: planning reads bags by the native module.
    text = made("first-verdict")
    module = text.index("Building bagpipe.MemoryBag into .venv")
    assert module < text.index("Running the demonstration's job without Kubernetes")


@pytest.mark.parametrize("goal", ["test-e2e", "test-nodes", "test-slow"])
def test_whole_jobs_have_what_reads_their_recordings(goal: str) -> None:
    # Asked for by themselves in a fresh checkout, they failed: what they record is read here.
    text = made(goal)
    tests = re.search(r"-m pytest[^$]*?tests/e2e", text)
    assert tests is not None
    assert text.index("Building bagpipe.MemoryBag into .venv") < tests.start()


def crates_of(name: str) -> set[str]:
    """A crate's folder and those of all that it needs of the workspace."""
    manifest = tomllib.loads((CRATES / name / "Cargo.toml").read_text())
    needed = (each.removeprefix("bagpipe-") for each in manifest["dependencies"])
    inner = [each for each in needed if (CRATES / each / "Cargo.toml").exists()]
    return {name}.union(*(crates_of(each) for each in inner))


def test_a_change_of_each_crate_of_the_native_module_builds_it_again() -> None:
    text = subprocess.run(
        ["make", "--dry-run", "--print-data-base", "help"],
        cwd=ROOT, capture_output=True, text=True, timeout=60, check=False,
    ).stdout  # fmt: skip
    line = re.search(r"^\.venv/\.memory-bag: (.*)$", text, re.MULTILINE)
    assert line is not None
    listed = set(re.findall(r"images/agent/crates/(\w+)/src/lib\.rs", line[1]))
    assert listed == crates_of("python") >= {"python", "log", "rosbag", "mcap"}


def test_kind_loads_the_images_that_were_built_and_no_others() -> None:
    # kind stops at an image that Docker has not: the demonstration builds five of nine.
    text = made("demo", "CLUSTER=kind")
    built = re.search(r"--engine docker --no-archives (.*)$", text, re.MULTILINE)
    loaded = re.search(r"kind load docker-image --name bagpipe (.*)$", text, re.MULTILINE)
    assert built is not None
    assert loaded is not None
    names = [each.split("/")[1].split(":")[0] for each in loaded[1].split()]
    assert names == built[1].split()
    assert len(names) == 5


def test_kind_takes_its_own_node_unless_another_is_named() -> None:
    assert "--image" not in made("demo", "CLUSTER=kind")
    text = made("demo", "CLUSTER=kind", "KIND_IMAGE=here/node:1")
    assert 'kind.yaml --wait 3m --image "here/node:1"' in text


@pytest.mark.parametrize("two", ["linux/amd64 linux/arm64", "linux/amd64,linux/arm64"])
def test_a_release_for_this_machine_alone_gets_no_other_compiler(two: str) -> None:
    # `preflight` without the name of a set installs all that there are.
    for platforms, times in (("linux/amd64", 0), (two, 1)):
        text = made("release-platforms", f"PLATFORMS={platforms}")
        assert text.count("Getting compilers for") == times
        assert re.findall(r"Getting compilers.*preflight ?(.*)$", text, re.MULTILINE) == (
            ["cross"] * times
        )


def test_what_measures_the_machine_and_whole_jobs_run_after_one_another() -> None:
    steps = re.findall(r'"(Testing [^"]*)"', made("test"))
    assert steps == [
        "Testing what measures the machine",
        "Testing the Python packages and the cluster's parts",
        "Testing the agent",
        "Testing worker, agent and real nodes",
        "Testing whole jobs on Kubernetes",
        "Testing how soon trouble is reported",
    ]


def test_what_runs_beside_another_is_printed_at_its_end_and_nothing_else(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setenv("AT_ITS_END", "high")
    beside, alone = (
        re.search(r'"Testing the agent" (.*) -- env', made(goal))
        for goal in ("test-real-parts", "test-rust")
    )
    assert beside is not None
    assert alone is not None
    assert (beside[1], alone[1].strip()) == ("--output-at-its-end", "")


@pytest.mark.parametrize(("goal", "priority"), [("demo", "nice -n 15 "), ("prepare", "")])
def test_images_give_way_to_the_first_verdict_alone(goal: str, priority: str) -> None:
    text = made(goal)
    assert re.search(rf'"Building images" --\s+{priority}python3 images/build/build.py', text)


@pytest.mark.parametrize(
    ("goal", "step"),
    [
        ("test-rust", r'"Compiling the agent\'s tests"'),
        ("lint-sources", '"Linting"'),
        ("test-one", r"-m tests\.quick\.one"),
    ],
)
def test_no_checkout_takes_what_another_has_built_for_its_own(goal: str, step: str) -> None:
    text = made(goal, "T=images/agent/crates/replay/tests/rest.rs")
    claimed = [at.start() for at in re.finditer("claim.py .*cargo-debug", text)]
    (begun,) = (at.start() for at in re.finditer(step, text))
    assert len(claimed) == 1
    assert claimed[0] < begun
