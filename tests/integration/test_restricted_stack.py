"""Debian's ROS as a stack without rights: user 65532, no capabilities, a read-only file system.

What a kubelet does with the manifest's securityContext, done by hand to the agent's process.
"""

import collections
import os
import shutil
import signal
import subprocess
import tempfile
from collections.abc import Iterator
from pathlib import Path

import pytest

from bagpipe.run.master_ports import master_ports
from bagpipe_operator.api.names import BAGPIPE_UID
from bagpipe_operator.jobs.pods.pod_parts import STACK_UID
from tests.integration.conftest import RunningAgent, _await_ready
from tests.integration.stacks import folders_with_recording, stepped
from tests.integration.test_real_stack import run_all
from tests.recording import MESSAGES

pytestmark = pytest.mark.integration

# The shared volume and HOME stay writable, for they are volumes; all else is remounted.
WALLS = """
set -eu
mount --make-rprivate /
for volume in "$SHARED" "$HOME"; do mount --bind "$volume" "$volume"; done
mount -o remount,bind,ro /
exec setpriv --reuid "$STACK" --regid "$STACK" --groups "$GROUP" --no-new-privs \
  --bounding-set=-all --inh-caps=-all "$@"
"""


@pytest.fixture
def master_port() -> Iterator[int]:
    """A port that no other test takes meanwhile."""
    with master_ports(1) as port:
        yield port


@pytest.fixture
def restricted_agent(agent_binary: Path, master_port: int) -> Iterator[RunningAgent]:
    """An agent as the stack's container starts it, on volumes as the kubelet makes them."""
    folder = Path(tempfile.mkdtemp(prefix="bagpipe-restricted-"))
    folder.chmod(0o755)
    shared, home = folder / "shared", folder / "home"
    for volume in (shared, home):
        volume.mkdir()
        os.chown(volume, 0, BAGPIPE_UID)
        volume.chmod(0o2777)
    as_bagpipe = {"user": BAGPIPE_UID, "group": BAGPIPE_UID, "extra_groups": []}
    program = folder / "bagpipe-agent"
    shutil.copy(agent_binary, program)
    subprocess.run([program, "install", shared], check=True, timeout=30, **as_bagpipe)  # type: ignore[call-overload]
    agent = shared / "bin" / "bagpipe-agent"
    serve = [agent, "serve", "--shared", shared, "--slots", "1", "--master-port", master_port]
    log = folder / "agent.log"
    with log.open("wb") as output:
        process = subprocess.Popen(
            ["unshare", "--mount", "sh", "-c", WALLS, "walls", *map(str, serve)],
            stdout=output,
            stderr=subprocess.STDOUT,
            env={
                "PATH": "/usr/lib/robot_state_publisher:/usr/bin:/bin",
                "HOME": str(home), "TMPDIR": str(home), "SHARED": str(shared), "USER": "bagpipe",
                "STACK": str(STACK_UID), "GROUP": str(BAGPIPE_UID),
            },
            start_new_session=True,
        )  # fmt: skip
    running = RunningAgent(shared, process, log)
    try:
        _await_ready(program, running)
        yield running
    finally:
        process.send_signal(signal.SIGTERM)
        process.wait(timeout=90)
        shutil.rmtree(folder)


def test_every_message_arrives_at_a_stack_without_rights(
    restricted_agent: RunningAgent, tmp_path: Path
) -> None:
    status = Path(f"/proc/{restricted_agent.process.pid}/status").read_text()
    facts = dict(line.split(":", 1) for line in status.splitlines())
    assert facts["Uid"].split() == [str(STACK_UID)] * 4
    assert (facts["CapEff"].strip(), facts["NoNewPrivs"].strip()) == ("0" * 16, "1")
    mounts = Path(f"/proc/{restricted_agent.process.pid}/mounts").read_text().splitlines()
    roots = [line.split() for line in mounts if line.split()[1] == "/"]
    assert "ro" in roots[-1][3].split(",")
    rows = run_all(stepped(), folders_with_recording(tmp_path), restricted_agent)
    log = restricted_agent.log.read_text()
    assert [(row["outcome"], row["message"]) for row in rows] == [("passed", "")] * 4, log
    ledger: collections.Counter[str] = collections.Counter()
    for row in rows:
        ledger.update({k: v for k, v in row["result"]["ledger"].items() if k != "topics"})
    assert (ledger["sent"], ledger["received"], ledger["dropped"]) == (MESSAGES, MESSAGES, 0)
