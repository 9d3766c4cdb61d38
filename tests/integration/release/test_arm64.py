"""The agent and the wheel for arm64 are compiled, and run under an emulator.

    .venv/bin/python -m pytest tests/integration/release/test_arm64.py

The compiler comes first: `make release-platforms`, as `make test-slow` does.
"""

from __future__ import annotations

import ast
import json
import os
import re
import signal
import socket
import subprocess
import zipfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import bagpipe_bag
import context
import cross
import pytest
import wheels
from context import VERSION

from tests import recording
from tests.integration.release.emulation import Emulator, emulator
from tests.ports import free_port
from tests.waiting import PATIENCE, wait_until

pytestmark = [pytest.mark.slow, pytest.mark.timeout(7200)]

(ARM64,) = (target for target in cross.TARGETS if target.arch == "arm64")
TAGS = "cp311-abi3-manylinux_2_34_aarch64"


@pytest.fixture(scope="module")
def agent() -> Path:
    return context.agent_binary(ARM64)


@pytest.fixture(scope="module")
def wheel(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return wheels.build_for(ARM64, tmp_path_factory.mktemp("wheels"))


@pytest.fixture(scope="module")
def arm64() -> Emulator:
    return emulator()


@pytest.fixture(scope="module")
def drive() -> Path:
    return recording.fetch()


def elf(flag: str, path: Path) -> str:
    done = subprocess.run(
        ["readelf", "--wide", flag, path], capture_output=True, text=True, timeout=60, check=True
    )
    return done.stdout


def newest_glibc(path: Path) -> tuple[int, ...]:
    """The newest glibc that a program or library asks for."""
    found = re.findall(r"Name: GLIBC_([\d.]+)", elf("--version-info", path))
    return max(tuple(map(int, each.split("."))) for each in found)


def test_the_agent_is_a_static_program_of_arm64(agent: Path) -> None:
    assert "Machine:                           AArch64" in elf("--file-header", agent)
    assert "INTERP" not in elf("--program-headers", agent)
    assert "NEEDED" not in elf("--dynamic", agent)


def test_what_it_loads_into_nodes_asks_for_as_old_a_glibc_as_on_amd64(agent: Path) -> None:
    built = agent.parent / "build"
    assert newest_glibc(last(built, "libbagpipe_ros2ledger.so")) <= (2, 31)
    assert newest_glibc(last(built, "bagpipe-ros2player")) <= (2, 17)
    assert "INTERP" not in elf("--program-headers", last(built, "bagpipe-ros2player-dds"))


def last(built: Path, name: str) -> Path:
    """What the last run of a build script has left under a name."""
    return max(built.glob(f"*/out/{name}"), key=lambda path: path.stat().st_mtime)


def test_it_reads_and_writes_recordings(
    agent: Path, arm64: Emulator, drive: Path, tmp_path: Path
) -> None:
    assert arm64.run(agent, "--version") == f"bagpipe-agent {VERSION}\n"
    assert f"joint_states        {recording.MESSAGES}" in arm64.run(agent, "info", str(drive))
    made = tmp_path / "drive.mcap"
    arm64.run(agent, "convert", str(drive), "--output", str(made))
    # This machine's own module reads what the other wrote.
    assert facts(made)["topics"] == [
        ("joint_states", "sensor_msgs/JointState", "ros1", recording.MESSAGES)
    ]
    assert facts(made)["damage"] is None
    assert arm64.run(agent, "check", str(made)) == f"{made}: {recording.MESSAGES} whole messages\n"
    cut = tmp_path / "cut.mcap"
    cut.write_bytes(made.read_bytes()[:-100_000])
    done = subprocess.run(
        arm64.command(agent, "check", str(cut)), capture_output=True, text=True, timeout=60,
        check=False,
    )  # fmt: skip
    assert done.returncode == 1


def facts(path: Path) -> dict[str, object]:
    return bagpipe_bag.describe_recording(path, 1 << 30)


@contextmanager
def running(*command: str, **settings: str) -> Iterator[subprocess.Popen[str]]:
    """A process, which ends with the block at the latest."""
    with subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True,
        env={**os.environ, **settings},
    ) as process:  # fmt: skip
        try:
            yield process
        finally:
            process.kill()


def listens(port: int) -> bool:
    with socket.socket() as tried:
        return tried.connect_ex(("127.0.0.1", port)) == 0


def test_it_plays_and_records_without_loss(
    agent: Path, arm64: Emulator, drive: Path, tmp_path: Path
) -> None:
    port = free_port()
    ros = {"ROS_MASTER_URI": f"http://127.0.0.1:{port}", "ROS_IP": "127.0.0.1"}
    record = arm64.command(agent, "record", "--output", str(tmp_path / "got.bag"), "joint_states")
    with running("rosmaster", "--core", "-p", str(port), **ros):
        wait_until(lambda: listens(port), PATIENCE, "the master does not listen")
        with running(*record, **ros) as recorder:
            played = arm64.run(
                agent, "play", str(drive), "--immediate", "--json", "--subscribers",
                "joint_states=1", **ros,
            )  # fmt: skip
            recorder.send_signal(signal.SIGTERM)
            assert recorder.wait(PATIENCE) == 0
    ledger = json.loads(played)["ledger"]
    assert (ledger["sent"], ledger["received"], ledger["dropped"], ledger["strength"]) == (
        recording.MESSAGES, recording.MESSAGES, 0, "received",
    )  # fmt: skip
    got = bagpipe_bag.MemoryBag.open(tmp_path / "got.bag")
    assert (got.message_count, got.damage) == (recording.MESSAGES, None)


def test_the_wheel_is_for_arm64_and_has_the_agent(wheel: Path, agent: Path, tmp_path: Path) -> None:
    assert wheel.name == f"bagpipe-{VERSION}-{TAGS}.whl"
    with zipfile.ZipFile(wheel) as opened:
        opened.extractall(tmp_path)
    assert f"Tag: {TAGS}\n" in (tmp_path / f"bagpipe-{VERSION}.dist-info/WHEEL").read_text()
    inside = tmp_path / f"bagpipe-{VERSION}.data/scripts/bagpipe-agent"
    assert inside.read_bytes() == agent.read_bytes()
    (module,) = (tmp_path / "bagpipe_bag").glob("*.so")
    assert "Machine:                           AArch64" in elf("--file-header", module)
    assert newest_glibc(module) <= (2, 34)


def test_python_of_arm64_imports_its_module(
    wheel: Path, agent: Path, arm64: Emulator, drive: Path, tmp_path: Path
) -> None:
    made = tmp_path / "drive.mcap"
    arm64.run(agent, "convert", str(drive), "--output", str(made))
    with zipfile.ZipFile(wheel) as opened:
        opened.extractall(tmp_path)
    code = (
        "import os, sys, bagpipe_bag\n"
        "found = bagpipe_bag.describe_recording(sys.argv[1], 1 << 30)\n"
        "print((os.uname().machine, found))"
    )
    answer = arm64.run(arm64.python, "-c", code, str(made), PYTHONPATH=str(tmp_path))
    assert ast.literal_eval(answer) == ("aarch64", facts(made))
