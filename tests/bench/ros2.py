"""`make bench BENCH=ros2`: plays and recordings of ROS 2 beside rosbag2's, where a ROS 2 is.

Both play the same recording to the same node, as fast as they can, and record the same publisher.
What a node got is by its own count, in its own time. In turns, in one run of this program.
"""

import re
import shutil
import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TypeVar

import yaml

from tests.agent_binary import built
from tests.bench.rows import Row
from tests.ros2_real import nodes
from tests.ros2_real.agent import agent
from tests.ros2_real.jobs import Trial, ledger_of, passed
from tests.ros2_real.place import Place, found
from tests.ros2_real.recordings import write_texts

T = TypeVar("T")
RUNS = 5
SMALL, LARGE = 100_000, 300
STEPS = 2000
RATES = (10_000, 20_000, 80_000)
# Nothing of it is a slot's, whose domains have the numbers of its ports.
_DOMAIN = "101"
# Recorder and publisher find each other, and the last message is on its way.
_ALONE = "export ROS_DOMAIN_ID=$DOMAIN ROS_AUTOMATIC_DISCOVERY_RANGE=LOCALHOST\n"
_PLAY = """
$PREFIX/lib/bagpipe_nodes/node single Counting --ros-args -p report:=$FOLDER/report & node=$!
ros2 bag play -s mcap --disable-keyboard-controls --delay 3 $FOLDER/recordings/drive.mcap
sleep 1; kill -INT $node; wait $node
"""
_RECORD = """
$PREFIX/lib/bagpipe_nodes/node single Sending --ros-args $PARAMETERS & node=$!
ros2 bag record -s mcap --disable-keyboard-controls -o $FOLDER/recorded --topics /out & recorder=$!
sleep 4; ros2 topic pub --once /in std_msgs/msg/String "{data: go}"
sleep $SECONDS_OF_IT; kill -INT $recorder; wait $recorder; kill -INT $node; wait $node
"""
_PING = """
$PREFIX/lib/bagpipe_nodes/node single Passing & node=$!
timeout 60 $PREFIX/lib/bagpipe_nodes/node single Pinging --ros-args $PARAMETERS
kill -INT $node; wait $node
"""


@dataclass(frozen=True)
class Delivery:
    """Messages that a node counted, seconds from the first to the last, and before the first."""

    messages: int
    seconds: float
    before: float

    @property
    def rate(self) -> float:
        """Messages per second."""
        return (self.messages - 1) / self.seconds if self.seconds else 0.0


@dataclass(frozen=True)
class Bench:
    """Where ROS 2, its nodes and the bench's files are, and by which middleware it goes."""

    place: Place
    prefix: Path
    trial: Trial
    folder: Path

    def bash(self, script: str, **variables: str) -> str:
        """Runs a script where ROS 2 is; its output."""
        known = {"PREFIX": str(self.prefix), "FOLDER": str(self.folder), "DOMAIN": _DOMAIN}
        known |= {"RMW_IMPLEMENTATION": self.trial.rmw, **variables}
        exports = "".join(f"export {name}='{value}'\n" for name, value in known.items())
        words = ["bash", "-c", exports + _ALONE + script]
        done = self.place.run(words, self.prefix, [self.folder])
        return done.stdout + done.stderr

    def node(self, kind: str, *parameters: str) -> list[str]:
        """The command of a node, as a job has it."""
        arguments = [word for one in parameters for word in ("-p", one)]
        node = self.prefix / "lib/bagpipe_nodes/node"
        return [str(node), "single", kind, "--ros-args", *arguments]


@contextmanager
def benches(rmw: str) -> Iterator[Bench]:
    """One, in memory: what is measured is no disk."""
    place = found()
    prefix, binary = nodes.built(place), built()
    folder = Path(tempfile.mkdtemp(prefix="bagpipe-ros2-", dir="/dev/shm"))
    claims = {name: str(folder / name) for name in ("recordings", "results")}
    try:
        for path in claims.values():
            Path(path).mkdir()
        with agent(place, prefix, binary, folder) as running:
            yield Bench(place, prefix, Trial(claims, running, rmw), folder)
    finally:
        shutil.rmtree(folder)


def _reported(bench: Bench) -> Delivery:
    messages, nanoseconds, before = _report(bench)
    return Delivery(messages, nanoseconds / 1e9, before / 1e9)


def _report(bench: Bench) -> list[int]:
    report = bench.folder / "report"
    numbers = [int(word) for word in report.read_text().split()]
    report.unlink()
    return numbers


def play_ours(bench: Bench) -> Delivery:
    """At full speed, with its proof."""
    command = bench.node("Counting", f"report:={bench.folder}/report")
    row = bench.trial.run(bench.trial.spec(command, {"mode": "max"}))
    # It only counts: nothing of it is recorded.
    assert row["reason"] == "NothingRecorded", row
    assert ledger_of(row)[2] == 0, row
    return _reported(bench)


def play_theirs(bench: Bench) -> Delivery:
    """As fast as their player goes."""
    output = bench.bash(_PLAY)
    assert (bench.folder / "report").exists(), output
    delivery = _reported(bench)
    # One that can't publish at all loses nothing that could be compared.
    assert delivery.messages > 0, output
    return delivery


def _sending(rate: int) -> tuple[str, ...]:
    return f"messages:={2 * rate}", f"rate:={rate}"


def record_ours(bench: Bench, rate: int) -> int:
    """Messages that were lost of two seconds."""
    row = bench.trial.run(bench.trial.spec(bench.node("Sending", *_sending(rate)), {"mode": "max"}))
    if row["reason"] == "RecordingIncomplete":
        lost = re.search(r"(\d+) messages of /out did not reach the recorder", row["message"])
        assert lost is not None, row
        return int(lost[1])
    assert passed(row), row
    return 2 * rate - int(row["result"]["recorded"]["messages"])


def record_theirs(bench: Bench, rate: int) -> int:
    """The same by their recorder."""
    parameters = " ".join(f"-p {one}" for one in _sending(rate))
    output = bench.bash(_RECORD, PARAMETERS=parameters, SECONDS_OF_IT="5")
    about = bench.folder / "recorded/metadata.yaml"
    assert about.exists(), output
    count = yaml.safe_load(about.read_text())["rosbag2_bagfile_information"]["message_count"]
    shutil.rmtree(about.parent)
    assert int(count) > 0, output
    return 2 * rate - int(count)


def turns(ours: Callable[[], T], theirs: Callable[[], T]) -> tuple[list[T], list[T]]:
    """Both in turns."""
    pairs = [(ours(), theirs()) for _ in range(RUNS)]
    return [pair[0] for pair in pairs], [pair[1] for pair in pairs]


def plays(bench: Bench) -> list[Row]:
    """Recordings of small and large messages into a queue of ten."""
    rows = []
    for name, size, messages, target in (
        ("1 KB", 1000, SMALL, 1.5),
        ("1 MB", 1 << 20, LARGE, None),
    ):
        texts = ("x" * size for _ in range(messages))
        recording = bench.folder / "recordings/drive.mcap"
        write_texts(recording, {"/in": texts}, period=1000)
        ours, theirs = turns(lambda: play_ours(bench), lambda: play_theirs(bench))
        case = f"{bench.trial.rmw}, play {name}"
        rates = [one.rate for one in ours], [one.rate for one in theirs]
        lost = [[float(messages - one.messages) for one in side] for side in (ours, theirs)]
        rows.append(Row(case, "delivered", "msg/s", rates[0], "ros2 bag play", rates[1], target))
        rows.append(Row(case, "lost", "messages", lost[0], "ros2 bag play", lost[1]))
        # Their player waits for as long as it is asked to, and for nobody.
        before = [one.before for one in ours]
        rows.append(Row(case, "first message after the node's start", "s", before, "", []))
        print(rows[-3:], flush=True)
    return rows


def records(bench: Bench) -> list[Row]:
    """A publisher with a queue of ten."""
    rows = []
    write_texts(bench.folder / "recordings/drive.mcap", {"/in": ["go"]})
    for rate in RATES:
        ours, theirs = turns(
            lambda rate=rate: float(record_ours(bench, rate)),  # type: ignore[misc]
            lambda rate=rate: float(record_theirs(bench, rate)),  # type: ignore[misc]
        )
        case = f"{bench.trial.rmw}, record 1 KB at {rate:,}/s"
        rows.append(Row(case, "lost", "messages", ours, "ros2 bag record", theirs))
        print(rows[-1], flush=True)
    return rows


def step_ours(bench: Bench) -> float:
    """Microseconds of one, its proof included."""
    steps = [{"trigger": "/in", "answer": "/out", "deadline": "20s"}]
    job = bench.trial.spec(bench.node("Passing"), {"mode": "lockstep", "steps": steps})
    row = bench.trial.run(job)
    assert passed(row), row
    return float(row["result"]["timings"]["play"]) / STEPS * 1e6


def step_theirs(bench: Bench) -> float:
    """The same of a node that does no more than publish when an answer has come."""
    parameters = f"-p report:={bench.folder}/report -p rounds:={STEPS}"
    output = bench.bash(_PING, PARAMETERS=parameters)
    assert (bench.folder / "report").exists(), output
    rounds, nanoseconds = _report(bench)
    return nanoseconds / rounds / 1e3


def steps(bench: Bench) -> list[Row]:
    """What a step of lock-step takes, the node's callback included."""
    texts = ("x" * 1000 for _ in range(STEPS))
    write_texts(bench.folder / "recordings/drive.mcap", {"/in": texts})
    ours, theirs = turns(lambda: step_ours(bench), lambda: step_theirs(bench))
    case = f"{bench.trial.rmw}, lock-step 1 KB"
    return [Row(case, "per step", "us", ours, "an rclcpp client that waits", theirs)]


def versions(place: Place) -> dict[str, str]:
    """What the peers are."""

    def of(package: str) -> str:
        script = 'cat "$(ros2 pkg prefix --share $0)/package.xml"'
        text = place.run(["bash", "-c", script, package]).stdout
        version = re.search(r"<version>(.*?)</version>", text)
        return version[1] if version else ""

    packages = ("rclcpp", "rosbag2_transport", "rmw_cyclonedds_cpp", "rmw_fastrtps_cpp")
    return {package: of(package) for package in packages}


def measure() -> tuple[list[Row], dict[str, str], str]:
    """All of it for each middleware that is installed."""
    place = found()
    rows = []
    for rmw in place.rmws():
        with benches(rmw) as bench:
            for part in (plays, records, steps):
                rows += part(bench)
    note = (
        f"Each beside rosbag2 in turns, {RUNS} runs, in memory; medians of what the nodes counted."
    )
    return rows, versions(place), note
