"""The ways of a bag from storage through a node and back into storage, one call for each run.

`executor` is the product's own: the code of a Spark task (`run_case`) with the real agent behind
a slot's named pipes, its bags in memory or, by a switch of the agent's, in files. `by_rosbag` is
the way without us: a copy on the local disk, `rosbag play` and `rosbag record`.
"""

import contextlib
import os
import re
import shutil
import signal
import socket
import subprocess
import threading
import time
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any
from xmlrpc.client import ServerProxy

from bagpipe.plan.case import Case
from bagpipe.run.case_run import Row, RunContext, run_case
from bagpipe.source.planning import plan
from bagpipe.spec import SimulationJobSpec
from bagpipe.storage import Storage
from tests.bench.play_graph import PATIENCE, Graph, Node, compiled, graph

# Steps of a case that start and end a ROS graph, whatever becomes of the bag.
_GRAPH_STEPS = ("master", "stack", "subscribe", "stop")
_SETTLED = 3


@dataclass(frozen=True)
class Shape:
    """Messages of one size."""

    name: str
    size: int
    messages: int

    @property
    def megabytes(self) -> float:
        return self.size * self.messages / 1e6


@dataclass(frozen=True)
class Passage:
    """What came of a bag: messages that were recorded, and the seconds that count."""

    recorded: int
    seconds: float
    parts: dict[str, float] = field(default_factory=dict)


def forget(path: Path) -> None:
    """Have the page cache let go of a file."""
    descriptor = os.open(path, os.O_RDONLY)
    try:
        os.fdatasync(descriptor)
        os.posix_fadvise(descriptor, 0, 0, os.POSIX_FADV_DONTNEED)
    finally:
        os.close(descriptor)


def remember(path: Path) -> None:
    """Have the page cache hold a file."""
    with path.open("rb") as file:
        while file.read(1 << 20):
            pass


@dataclass(frozen=True)
class Executor:
    """An executor's parts: the agent serving one slot, and where claims are mounted."""

    shared: Path
    log: Path
    claims: dict[str, str]

    def passage(self, bag: Path, shape: Shape, *, cold: bool) -> Passage:
        """One case: the bag goes through the node, and its recording into storage."""
        spec = _spec(bag)
        (case,) = plan(spec, Storage(self.claims)).cases
        (forget if cold else remember)(bag)
        offset = self.log.stat().st_size
        row = self._run(case, spec)
        assert row["outcome"] == "passed", row
        assert case.messages == shape.messages
        steps: dict[str, float] = row["result"]["timings"]
        # What the agent took to make its files cold is the bench's work.
        cold_seconds = re.findall(r"forgotten after ([\d.]+) s", self._logged_since(offset))
        set_up = [float(seconds) for seconds in cold_seconds] or [0.0]
        whole = row["seconds"] - sum(set_up)
        work = whole - sum(steps[step] for step in _GRAPH_STEPS)
        play = steps["play"] + steps["drain"]
        parts = {"whole": whole, "in": steps["assemble"] - set_up[0], "play": play}
        Path(self.claims["results"], "out", row["recorded"]).unlink()
        return Passage(row["result"]["recorded"]["messages"], work, parts)

    def _run(self, case: Case, spec: SimulationJobSpec) -> Row:
        context = RunContext(
            "bench", spec, self.claims, "pvc://results/out", shared=str(self.shared)
        )
        return run_case(case, context)

    def _logged_since(self, offset: int) -> str:
        with self.log.open() as file:
            file.seek(offset)
            return file.read()


def _spec(bag: Path) -> SimulationJobSpec:
    return SimulationJobSpec.model_validate(
        {
            "source": {
                "bags": [f"pvc://bags/{bag.name}"],
                "topics": ["/data"],
                "fragment": {"length": "24h"},
            },
            "stack": {"image": "echo", "command": [str(compiled("echo")), "/data", "/echo"]},
            "playback": {"mode": "max"},
            "record": {"topics": ["/echo"]},
            "output": {"uri": "pvc://results/out"},
        }
    )


@contextlib.contextmanager
def executor(
    agent: Path, folder: Path, claims: dict[str, str], *options: str
) -> Iterator[Executor]:
    """A serving agent; it is ended with the block."""
    shared = folder / f"shared{len(list(folder.glob('shared*')))}"
    shared.mkdir()
    log = shared.with_suffix(".log")
    with socket.create_server(("127.0.0.1", 0)) as probe:
        port = probe.getsockname()[1]
    command = [str(agent), "serve", "--shared", str(shared), "--master-port", str(port), *options]
    # Debian's ROS tools are scripts of Debian's Python.
    environment = {**os.environ, "PATH": "/usr/bin:/bin"}
    with log.open("wb") as output:
        process = subprocess.Popen(command, stdout=output, stderr=output, env=environment)
    try:
        deadline = time.monotonic() + PATIENCE
        ready = [str(agent), "ready", "--shared", str(shared)]
        while subprocess.run(ready, capture_output=True, check=False).returncode:
            if time.monotonic() > deadline or process.poll() is not None:
                raise RuntimeError(f"the agent does not serve: {log.read_text()}")
            threading.Event().wait(0.02)
        yield Executor(shared, log, claims)
    finally:
        process.send_signal(signal.SIGTERM)
        process.wait(PATIENCE)


def by_rosbag(
    agent: Path, folder: Path, bag: Path, results: Path, *more: str, cold: bool
) -> Passage:
    """Debian's rosbag beside the same node: copy, play (with `more` options) and record, copy back.

    Starting the graph and the recorder does not count, nor does what it takes to see that they
    have come to rest.
    """
    local, recorded = folder / "local.bag", folder / "recorded.bag"
    recorded.unlink(missing_ok=True)
    with graph(folder) as scene:
        node = scene.start(compiled("echo"), "/data", "/echo")
        recorder = scene.start("/usr/lib/rosbag/record", "-O", recorded, "--quiet", "/echo")
        _await_subscriber(scene, "/data")
        _await_subscriber(scene, "/echo")
        _rest(node, recorder)
        (forget if cold else remember)(bag)
        begun = time.perf_counter()
        shutil.copyfile(bag, local)
        seconds = time.perf_counter() - begun
        if cold:
            forget(local)
        begun = time.perf_counter()
        options = ("--immediate", "--quiet", "--wait-for-subscribers", *more)
        scene.run("/usr/lib/rosbag/play", *options, local)
        ended = max(time.perf_counter(), _rest(node, recorder))
        seconds += ended - begun
        begun = time.perf_counter()
        recorder.end(signal.SIGINT)
        seconds += time.perf_counter() - begun
        info = scene.run(agent, "info", recorded)
    if cold:
        forget(recorded)
    begun = time.perf_counter()
    shutil.copyfile(recorded, results / "by-rosbag.bag")
    seconds += time.perf_counter() - begun
    found = re.search(r"^messages +(\d+)$", info, re.MULTILINE)
    for path in (local, recorded, results / "by-rosbag.bag"):
        path.unlink()
    return Passage(int(found[1]) if found else 0, seconds)


def _await_subscriber(scene: Graph, topic: str) -> None:
    master: Any = ServerProxy(f"http://127.0.0.1:{scene.port}/")
    deadline = time.monotonic() + PATIENCE
    while time.monotonic() < deadline:
        _code, _message, (_publishers, subscribers, _services) = master.getSystemState("/bench")
        if any(name == topic and nodes for name, nodes in subscribers):
            return
        threading.Event().wait(0.05)
    raise RuntimeError(f"nobody subscribed to {topic}")


def _rest(*nodes: Node) -> float:
    """Waits until none of them uses the processor; when the last one did."""
    deadline, calm, before = time.monotonic() + PATIENCE, 0, -1
    busy = time.perf_counter()
    while calm < _SETTLED and time.monotonic() < deadline:
        used = 0
        for node in nodes:
            stat = Path(f"/proc/{node.process.pid}/stat").read_text().rsplit(") ", 1)[1].split()
            used += int(stat[11]) + int(stat[12])
        if used - before > 1:
            calm, busy = 0, time.perf_counter()
        calm, before = calm + 1, used
        threading.Event().wait(0.15)
    return busy
