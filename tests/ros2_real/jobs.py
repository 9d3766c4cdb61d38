"""Jobs of nodes of a real ROS 2, played by the real agent as a worker does."""

import hashlib
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from mcap.reader import make_reader

from bagpipe.run.case_run import Row, RunContext, run_case
from bagpipe.source.planning import plan
from bagpipe.spec import SimulationJobSpec
from bagpipe.storage import Storage
from tests.integration.conftest import RunningAgent

NODE = ("ros2", "run", "bagpipe_nodes", "node")
PYTHON = ("ros2", "run", "bagpipe_nodes", "answering.py")
STEP = {"trigger": "/in", "answer": "/out", "deadline": "20s"}
LOCKSTEP = {"mode": "lockstep", "steps": [STEP]}
SIM_TIME = {"/**/use_sim_time": True}


@dataclass(frozen=True)
class Trial:
    """Where jobs are run: claims with a recording, an agent beside ROS 2, and a middleware."""

    folders: Mapping[str, str]
    agent: RunningAgent
    rmw: str

    def spec(
        self, command: Iterable[str], playback: Mapping[str, Any], **fields: Any
    ) -> SimulationJobSpec:
        """A job over drive.mcap whose answers on /out are recorded."""
        stack = {
            "engine": "ros2",
            "image": "registry.example/nodes:1",
            "command": list(command),
            "env": [{"name": "RMW_IMPLEMENTATION", "value": self.rmw}],
        } | fields.pop("stack", {})
        whole = {
            "source": {"bags": ["pvc://recordings/drive.mcap"], "fragment": {"length": "600s"}},
            "stack": stack,
            "playback": playback,
            "record": {"topics": ["/out"]},
            "output": {"uri": "pvc://results/r"},
        }
        return SimulationJobSpec.model_validate(whole | fields)

    def run(self, spec: SimulationJobSpec) -> Row:
        """The row of the one case; nothing of it runs on."""
        row = self.run_beside(spec)
        self.agent.await_no_descendants()
        return row

    def run_beside(self, spec: SimulationJobSpec, name: str = "lab/ros2") -> Row:
        """The same, beside cases of other slots."""
        folders = dict(self.folders)
        context = RunContext(name, spec, folders, "pvc://results/r", str(self.agent.shared))
        (case,) = plan(spec, Storage(folders)).cases
        return run_case(case, context)

    def recorded(self, row: Row) -> Path:
        """The case's recording."""
        assert row["recorded"], row
        return Path(self.folders["results"], "r", row["recorded"])

    def digest(self, row: Row) -> str:
        """Of all bytes that were recorded."""
        return hashlib.sha256(self.recorded(row).read_bytes()).hexdigest()

    def texts(self, row: Row, topic: str = "/out") -> list[str]:
        """What was recorded of a topic of std_msgs/msg/String."""
        return [text for _, text in self.timed_texts(row, topic)]

    def timed_texts(self, row: Row, topic: str = "/out") -> list[tuple[int, str]]:
        """The same, each with the time that it was recorded at, in ns."""
        with self.recorded(row).open("rb") as stream:
            all_of_it = make_reader(stream).iter_messages(topics=[topic], log_time_order=False)
            return [(message.log_time, text_of(message.data)) for _, _, message in all_of_it]


def text_of(data: bytes) -> str:
    """The text of a std_msgs/msg/String in little-endian CDR."""
    length = int.from_bytes(data[4:8], "little")
    return data[8 : 8 + length - 1].decode()


def ledger_of(row: Row) -> tuple[int, int, int, str]:
    """Messages sent, received and dropped, and the weakest strength."""
    ledger = row["result"]["ledger"]
    return ledger["sent"], ledger["received"], ledger["dropped"], ledger["strength"]


def passed(row: Row) -> bool:
    """Whether it has at the first attempt."""
    return (row["outcome"], row["attempts"]) == ("passed", 1)


def activating(command: str, node: str) -> str:
    """A script that starts a command and activates its node, as somebody does it by hand.

    `ros2 lifecycle` looks for the node only so long, and is repeated where it has not found it.
    """
    return f"""{command} &
until ros2 lifecycle set {node} configure; do sleep 1; done
until ros2 lifecycle set {node} activate; do sleep 1; done
wait"""
