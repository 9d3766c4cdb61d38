"""What the play bench measures: one function for each case, one call for each run."""

import json
import os
import re
import shutil
import signal
import subprocess
import threading
import time
from dataclasses import dataclass
from pathlib import Path

from tests.bench.play_graph import NODES, PYTHON, Graph, Node, bag, compiled, graph


@dataclass(frozen=True)
class Delivery:
    """What came of a play."""

    received: int
    seconds: float

    def rate(self) -> float:
        """Received per second."""
        return self.received / self.seconds if self.seconds > 0 else 0.0


@dataclass(frozen=True)
class Bench:
    """Where things lie."""

    agent: Path
    folder: Path


def _delivery(node: Node) -> Delivery:
    line = node.wait_for("received ")
    found = re.fullmatch(r"received (\d+) seconds ([\d.]+)", line)
    assert found is not None, line
    return Delivery(int(found[1]), float(found[2]))


def sink_bare(bench: Bench, size: int, messages: int) -> Delivery:
    """A bare writev loop into a program that only reads."""
    with graph(bench.folder) as scene:
        total = (size + 4) * messages
        sink = scene.start(PYTHON, NODES / "sink.py", "port", str(total))
        port = sink.wait_for("port ").split()[1]
        gather = str(max(1, min(1024, (1 << 20) // (size + 4))))
        scene.start(compiled("bare_writev"), port, str(size), str(messages), gather)
        return _messages(_delivery(sink), size)


def sink_play(bench: Bench, size: int, messages: int) -> Delivery:
    """The agent at full speed into the same program."""
    source = bag(bench.folder, size, messages)
    with graph(bench.folder) as scene:
        total = (size + 4) * messages
        sink = scene.start(PYTHON, NODES / "sink.py", "topic", "/data", str(total))
        sink.wait_for("ready")
        scene.start(bench.agent, "play", source, "--immediate", "--topics", "/data")
        return _messages(_delivery(sink), size)


def _messages(read: Delivery, size: int) -> Delivery:
    return Delivery(read.received // (size + 4), read.seconds)


def _counter(scene: Graph, library: str, messages: int) -> Node:
    if library == "rospy":
        node = scene.start(PYTHON, NODES / "counter.py", "/data", str(messages))
    else:
        node = scene.start(compiled("counter"), "/data", str(messages))
    node.wait_for("ready")
    return node


def node_play(bench: Bench, library: str, size: int, messages: int) -> Delivery:
    """The agent at full speed into a node; its own ledger must say what the node says."""
    source = bag(bench.folder, size, messages)
    with graph(bench.folder) as scene:
        counter = _counter(scene, library, messages)
        player = scene.start(
            bench.agent, "play", source, "--immediate", "--topics", "/data", "--json"
        )
        delivery = _delivery(counter)
        ledger = json.loads(player.wait_for("{"))["ledger"]
        assert ledger["received"] == delivery.received, (ledger, delivery)
        return delivery


def node_rosbag(bench: Bench, library: str, size: int, messages: int, *more: str) -> Delivery:
    """`rosbag play --immediate` into the same node."""
    source = bag(bench.folder, size, messages)
    with graph(bench.folder) as scene:
        counter = _counter(scene, library, messages)
        options = ("--immediate", "--quiet", "--wait-for-subscribers", *more)
        scene.start("/usr/bin/rosbag", "play", *options, source)
        return _delivery(counter)


def record(bench: Bench, size: int, messages: int, rate: int, *, ours: bool) -> Delivery:
    """Records a roscpp publisher; the messages that are in the bag, and the time it spans."""
    target = bench.folder / f"recorded-{'ours' if ours else 'rosbag'}.bag"
    target.unlink(missing_ok=True)
    with graph(bench.folder) as scene:
        if ours:
            recorder = scene.start(bench.agent, "record", "--output", target, "/data")
        else:
            recorder = scene.start("/usr/lib/rosbag/record", "-O", target, "--quiet", "/data")
        talker = scene.start(compiled("talker"), "/data", str(size), str(messages), str(rate))
        talker.wait_for("done seconds ")
        _await_sent(scene, talker, recorder)
        recorder.end(signal.SIGINT)
        info = scene.run(bench.agent, "info", target)
    found = re.search(r"^messages +(\d+)$", info, re.MULTILINE)
    spans = re.search(r"^duration +([\d.]+) s$", info, re.MULTILINE)
    assert found is not None, info
    assert spans is not None, info
    target.unlink()
    return Delivery(int(found[1]), float(spans[1]))


def _await_sent(scene: Graph, talker: Node, recorder: Node) -> None:
    """Waits until the recorder has had time to take what the publisher still holds: until
    neither uses the processor any more.
    """

    def used() -> int:
        total = 0
        for node in (talker, recorder):
            fields = Path(f"/proc/{node.process.pid}/stat").read_text().rsplit(") ", 1)[1].split()
            total += int(fields[11]) + int(fields[12])
        return total

    deadline, before, calm = time.monotonic() + 30, -1, 0
    pause = threading.Event()
    while calm < 3 and time.monotonic() < deadline:
        now = used()
        calm, before = (calm + 1 if now - before <= 1 else 0), now
        pause.wait(0.2)
    assert scene.nodes, "the graph is gone"


def start_to_ready(bench: Bench) -> float:
    """From starting `serve` until `ready` says so, in milliseconds, without its own time."""
    shared = bench.folder / "shared"
    shared.mkdir(exist_ok=True)
    check = [str(bench.agent), "ready", "--shared", str(shared)]
    begun = time.perf_counter()
    serve = subprocess.Popen(
        [str(bench.agent), "serve", "--shared", str(shared)], stderr=subprocess.DEVNULL
    )
    try:
        deadline = begun + 10
        while True:
            asked = time.perf_counter()
            if subprocess.run(check, capture_output=True, check=False).returncode == 0:
                return (asked - begun) * 1e3
            assert asked < deadline, "serve is not ready after 10 s"
    finally:
        serve.terminate()
        serve.wait(10)
        shutil.rmtree(shared)


def memory_beyond_bag(bench: Bench, size: int, messages: int) -> float:
    """The player's largest resident memory less the bag's own size, in MiB."""
    source = bag(bench.folder, size, messages)
    with graph(bench.folder) as scene:
        _counter(scene, "roscpp", messages)
        player = scene.start(bench.agent, "play", source, "--immediate", "--topics", "/data")
        _pid, status, usage = os.wait4(player.process.pid, 0)
        assert status == 0, player.output
    return (usage.ru_maxrss * 1024 - source.stat().st_size) / (1 << 20)


@dataclass(frozen=True)
class Steps:
    """A lock-step play, per step in microseconds."""

    whole: float
    own: float


def lockstep(bench: Bench, size: int, steps: int) -> Steps:
    """Steps through a roscpp node that answers with its input."""
    source = bag(bench.folder, size, steps)
    with graph(bench.folder) as scene:
        echo = scene.start(compiled("echo"), "/data", "/echo")
        out = scene.run(
            bench.agent, "play", source, "--topics", "/data", "--step", "/data=/echo,10", "--json"
        )
        own = echo.wait_for(f"own {steps} ")
    played = json.loads(out)
    (report,) = played["playback"]["steps"]
    assert (report["released"], report["answered"]) == (steps, steps), report
    assert played["ledger"]["dropped"] == 0, played["ledger"]
    whole = played["playback"]["played_seconds"] / steps * 1e6
    return Steps(whole, float(own.split()[-1]) / steps * 1e6)
