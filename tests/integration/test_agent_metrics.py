"""The agent's /metrics beside a real case: what it exposes and hides, and who can hurt it."""

import socket
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import pytest
import urllib3
from prometheus_client.parser import text_string_to_metric_families

from bagpipe.run.case_run import RunContext, run_case
from bagpipe.source.planning import plan
from bagpipe.spec import SimulationJobSpec
from bagpipe.storage import Storage
from charts.monitoring import generate
from tests.integration.conftest import ROOT, RunningAgent
from tests.integration.stacks import folders_with_recording, in_one_piece, whole_fields
from tests.ports import free_port
from tests.recording import MESSAGES
from tests.waiting import PATIENCE, wait_until

pytestmark = pytest.mark.integration

StartAgent = Callable[..., RunningAgent]
Figures = dict[tuple[str, str], float]

NODE = ROOT / "tests/integration/nodes/held_relay.py"
# Messages that it answers before it waits.
HELD = 500


class Watched:
    """An agent with its endpoint, and a case in lock-step for it."""

    def __init__(self, tmp_path: Path, start_agent: StartAgent) -> None:
        self.address = ("127.0.0.1", free_port())
        self.agent = start_agent(1, None, "--metrics", "{}:{}".format(*self.address))
        self.folders = folders_with_recording(tmp_path)
        self.spec = in_one_piece()
        (self.case,) = plan(self.spec, Storage(self.folders)).cases

    def hold(self, count: int, gate: Path) -> None:
        """Gives the case a node that answers so many messages, and more once there is the file."""
        words = ["sensor_msgs/JointState", "/joint_states", "/relayed", str(count), str(gate)]
        step = {"trigger": "/joint_states", "answer": "/relayed", "deadline": f"{PATIENCE:.0f}s"}
        fields = whole_fields()
        fields["stack"]["command"] = ["/usr/bin/python3", str(NODE), *words]
        fields["playback"]["steps"] = [step]
        fields["record"]["topics"] = ["/relayed"]
        self.spec = SimulationJobSpec.model_validate(fields)
        (self.case,) = plan(self.spec, Storage(self.folders)).cases

    def run(self) -> dict[str, Any]:
        """The case's row."""
        shared = str(self.agent.shared)
        context = RunContext("lab/pr2", self.spec, self.folders, "pvc://results/r", shared)
        return dict(run_case(self.case, context))

    def page(self) -> str:
        """What a scrape gets."""
        url = "http://{}:{}/metrics".format(*self.address)
        return urllib3.request("GET", url, timeout=20, retries=False).data.decode()

    def figures(self) -> Figures:
        """Its samples by name and the value of their one label."""
        return {
            (sample.name, next(iter(sample.labels.values()), "")): sample.value
            for family in text_string_to_metric_families(self.page())
            for sample in family.samples
        }

    def after(self, cases: int) -> Figures:
        """The samples once so many cases are counted; a slot reports an end after its worker."""
        counted = ("bagpipe_agent_cases_ended_total", "answered")
        wait_until(
            lambda: self.figures()[counted] >= cases, PATIENCE, "a case's end is not reported"
        )
        found = self.figures()
        assert found[counted] == cases
        return found

    def resident(self) -> int:
        """Bytes that `serve` has in memory."""
        status = Path(f"/proc/{self.agent.process.pid}/status").read_text().splitlines()
        return next(int(line.split()[1]) * 1024 for line in status if line.startswith("VmRSS:"))


@pytest.fixture
def watched(tmp_path: Path, start_agent: StartAgent) -> Watched:
    return Watched(tmp_path, start_agent)


def test_a_real_case_is_seen_while_it_runs_and_adds_up(watched: Watched, tmp_path: Path) -> None:
    gate = tmp_path / "gate"
    watched.hold(HELD, gate)

    def held() -> Figures | None:
        now = watched.figures()
        # Figures are added one after the other, and a report may come between two of them.
        counted = (
            now[f"bagpipe_agent_{name}_messages_total", ""] for name in ("played", "recorded")
        )
        return now if min(counted) >= HELD else None

    with ThreadPoolExecutor(1) as beside:
        running = beside.submit(watched.run)
        try:
            during = wait_until(held, PATIENCE, "no progress is seen")
        finally:
            gate.touch()
        row = running.result()
    assert row["outcome"] == "passed", row
    # In lock-step a message counts when it is answered, and the answer of the next one is awaited.
    assert during["bagpipe_agent_played_messages_total", ""] == HELD
    assert during["bagpipe_agent_recorded_messages_total", ""] == HELD
    assert during["bagpipe_agent_recordings_size_bytes", ""] > 0
    assert during["bagpipe_agent_slots_busy", ""] == 1
    assert during["bagpipe_agent_cases_ended_total", "answered"] == 0
    after = watched.after(1)
    result = row["result"]
    expected = {
        "fragment_received_bytes_total": result["input_bytes"],
        "recorded_bytes_total": result["recorded"]["bytes"],
        "recorded_messages_total": result["recorded"]["messages"],
        "recorder_high_water_bytes": result["recorded"]["high_water_bytes"],
        "pipe_size_bytes": result["pipe_bytes"],
        "slots_busy": 0,
    }
    assert {name: after[f"bagpipe_agent_{name}", ""] for name in expected} == expected
    counted = {key: after["bagpipe_agent_ledger_messages_total", key] for key in result["ledger"]
               if ("bagpipe_agent_ledger_messages_total", key) in after}  # fmt: skip
    assert counted == {"sent": MESSAGES, "received": MESSAGES, "dropped": 0}
    (step,) = result["playback"]["steps"]
    assert after["bagpipe_agent_lockstep_wait_seconds_count", ""] == step["answered"]
    waited = after["bagpipe_agent_lockstep_wait_seconds_sum", ""]
    assert waited == pytest.approx(step["waited_seconds"])


def test_nothing_of_the_job_is_exposed(watched: Watched) -> None:
    watched.run()
    page = watched.page()
    for word in ("lab/", "pr2", watched.case.id, "joint_states", "robot_state_publisher"):
        assert word not in page, word
    # No series that an agent has not had from the beginning: none of a job's own making.
    series = {line.rsplit(" ", 1)[0] for line in page.splitlines()}
    first = (generate.ROOT / generate.AGENT_PAGE).read_text()
    assert series == {line.rsplit(" ", 1)[0] for line in first.splitlines()}


def test_hostile_requests_hold_up_no_case(watched: Watched) -> None:
    alone = watched.run()
    before = watched.resident()
    endless = b"GET /metrics HTTP/1.1\r\nX: " + b"x" * (1 << 20)
    requests = [b"", b"GET /metr", b"\x16\x03\x01\x02\x00\x01", b"\r\n" * 99, endless]
    held = []
    for request in requests * 8:
        peer = socket.create_connection(watched.address, timeout=30)
        peer.setblocking(False)
        peer.send(request)
        held.append(peer)
    row = watched.run()
    assert (row["outcome"], row["attempts"]) == ("passed", 1), row
    print("alone", alone["seconds"], "beside hostile peers", row["seconds"])
    assert watched.resident() < before + (8 << 20)
    watched.after(2)
    for peer in held:
        peer.close()
