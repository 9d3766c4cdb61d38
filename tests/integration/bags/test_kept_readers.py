"""Every bag that Bagpipe writes, held to the readers that are in use, message by message.

Their writers keep one order of fields for a whole bag, so that some readers take the first
record's for all. A slice, a merge or a new index is made of bags that any recorder wrote.
"""

import random
import shutil
import subprocess
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from bagpipe import MemoryBag
from bagpipe.encodings import ROS1
from bagpipe.run.case_run import RunContext, run_case
from bagpipe.source.planning import plan
from bagpipe.source.sequence.stream import sequence
from bagpipe.spec import SimulationJobSpec
from bagpipe.storage import Storage
from tests.integration.bags.readers import (
    ReadAll,
    ReadMessage,
    by_bagpipe,
    by_rosbags,
    kept_readers,
)
from tests.integration.bags.sources import SECOND, Source, source
from tests.integration.conftest import ROOT, RunningAgent
from tests.recording import MESSAGES, fetch
from tests.unit.bagpipe.bags import steady, write_bag
from tests.waiting import patient

pytestmark = pytest.mark.integration

SOURCES = 60
COMPRESSIONS = ("none", "lz4", "bz2")
RELAY = ROOT / "tests/integration/nodes/relay_type.py"
Expected = dict[Path, list[ReadMessage]]


@pytest.fixture(scope="module")
def readers(tmp_path_factory: pytest.TempPathFactory) -> dict[str, ReadAll]:
    return kept_readers(tmp_path_factory.mktemp("readers"))


def assert_all_read(readers: dict[str, ReadAll], expected: Expected) -> None:
    for name, read in readers.items():
        found = read(list(expected))
        for path, messages in expected.items():
            messages_read = found[path]
            assert isinstance(messages_read, list), f"{name}, {path.name}: {messages_read}"
            assert sorted(messages_read) == sorted(messages), f"{name}, {path.name}"


def written(folder: Path, name: str, bag: MemoryBag) -> Path:
    path = folder / f"{name}.bag"
    path.write_bytes(bag.view())
    return path


def agent(binary: Path, *arguments: str | Path) -> None:
    subprocess.run([str(binary), *map(str, arguments)], check=True, timeout=120, stdout=-3)


def window_of(seed: int) -> tuple[int, int]:
    rng = random.Random(-seed)  # noqa: S311
    start = SECOND * 1_000 + rng.randrange(0, 3 * SECOND)
    return start, start + rng.randrange(1, 3 * SECOND)


def rewritten(bag: MemoryBag, compression: Any) -> MemoryBag:
    writer = MemoryBag.writer(compression=compression)
    for each, time, raw in bag.messages():
        writer.write(
            each.topic, time, raw, type=each.type, md5sum=each.md5sum,
            definition=each.definition, callerid=each.callerid, latching=each.latching,
        )  # fmt: skip
    return writer.finish()


def made_of(seed: int, folder: Path, binary: Path) -> Expected:
    """What is made of one generated source, or two, and what must be read of it."""
    one, two = source(seed), source(seed + SOURCES)
    compression: Any = COMPRESSIONS[seed % 3]
    bag, other = MemoryBag(one.data), MemoryBag(two.data)
    start, end = window_of(seed)
    parts = {
        "slice": (bag.slice(start, end, compression=compression), one.sliced(start, end)),
        "whole": (bag.slice(compression=compression), one.as_read()),
        "merge": (
            MemoryBag.merge([bag, other], compression=compression),
            one.as_read() + two.as_read(),
        ),
        "write": (rewritten(bag, compression), one.as_read()),
    }
    expected = {
        written(folder, f"{name}-{seed}", part): messages
        for name, (part, messages) in parts.items()
    }
    expected[by_reindex(one, seed, folder, binary)] = one.as_read()
    return expected


def by_reindex(one: Source, seed: int, folder: Path, binary: Path) -> Path:
    lost = folder / f"lost-{seed}.bag"
    lost.write_bytes(one.data[: one.index_position])
    path = folder / f"reindex-{seed}.bag"
    agent(binary, "reindex", lost, "--output", path, "--compression", COMPRESSIONS[seed % 3])
    return path


def test_generated_bags_of_every_order_are_read_by_all(
    readers: dict[str, ReadAll], agent_binary: Path, tmp_path: Path
) -> None:
    expected: Expected = {}
    for seed in range(SOURCES):
        expected |= made_of(seed, tmp_path, agent_binary)
    assert len(expected) == 5 * SOURCES
    assert_all_read(readers, expected)


def test_a_reader_that_stops_at_a_later_message_gets_all_of_a_window(tmp_path: Path) -> None:
    """Debian's Python ends at the first entry behind the window: those of a chunk are sorted."""
    writer = MemoryBag.writer()
    for time in (5, 3, 9, 4):
        writer.write("/t", time, b"", type="a/B", md5sum="0" * 32, definition="int32 b\n")
    path = written(tmp_path, "unsorted", writer.finish())
    count = (
        "import rosbag, genpy, sys; bag = rosbag.Bag(sys.argv[1]);"
        "print([t.to_nsec() for _, _, t in bag.read_messages(raw=True, end_time=genpy.Time(0, 5))])"
    )
    done = subprocess.run(
        ["/usr/bin/python3", "-c", count, str(path)], capture_output=True, text=True, timeout=60,
        check=False,
    )  # fmt: skip
    assert done.stdout.strip() == "[3, 4, 5]", done.stderr


def test_parts_of_the_real_recording_are_read_by_all(
    readers: dict[str, ReadAll], agent_binary: Path, tmp_path: Path
) -> None:
    recording = fetch()
    all_messages = by_rosbags(recording)
    first = min(each.time for each in all_messages)
    assert len(all_messages) == MESSAGES
    expected = {}
    for number, (start, end) in enumerate([(0, 16), (2, 9), (9, 20)]):
        path = tmp_path / f"part{number}.bag"
        agent(agent_binary, "slice", recording, "--start", str(start), "--end", str(end),
              "--output", path)  # fmt: skip
        expected[path] = [
            each for each in all_messages if start * SECOND <= each.time - first < end * SECOND
        ]
    merged = tmp_path / "merged.bag"
    agent(agent_binary, "merge", *list(expected)[1:], "--output", merged)
    expected[merged] = expected[tmp_path / "part1.bag"] + expected[tmp_path / "part2.bag"]
    cut = tmp_path / "cut.bag"
    cut.write_bytes(recording.read_bytes()[:-2000])
    indexed = tmp_path / "indexed.bag"
    agent(agent_binary, "reindex", cut, "--output", indexed)
    expected[indexed] = all_messages
    assert all(expected.values())
    assert_all_read(readers, expected)


def test_sequences_are_read_by_all(readers: dict[str, ReadAll], tmp_path: Path) -> None:
    write_bag(tmp_path / "a.bag", steady("/scan", 900, SECOND // 100), chunk_bytes=500)
    pieces = [{"bag": "pvc://recordings/a.bag", "from": "1s", "to": "6s"}] * 2
    spec = SimulationJobSpec.model_validate(
        {
            "source": {"sequence": pieces},
            "stack": {"image": "-", "command": ["true"]},
            "record": {"topics": ["/answer"]},
            "output": {"uri": "pvc://results/out"},
        }
    )
    storage = Storage({"recordings": str(tmp_path)})
    (case,) = plan(spec, storage).cases
    path = written(tmp_path, "sequence", MemoryBag(sequence(case, storage, ROS1)))
    expected = by_bagpipe(path)
    assert len(expected) == 1000
    assert_all_read(readers, {path: expected})


def test_what_the_agent_records_is_read_by_all(
    readers: dict[str, ReadAll], tmp_path: Path, start_agent: Callable[..., RunningAgent]
) -> None:
    folders = {name: str(tmp_path / name) for name in ("recordings", "results")}
    for folder in folders.values():
        Path(folder).mkdir()
    shutil.copyfile(fetch(), Path(folders["recordings"], "pr2.bag"))
    fields = {
        "source": {"bags": ["pvc://recordings/*.bag"], "topics": ["/joint_states"]},
        "stack": {
            "image": "-",
            "command": ["/usr/bin/python3", str(RELAY), "sensor_msgs/JointState",
                        "/joint_states", "/relayed"],
            "parameters": {"/use_sim_time": True},
        },
        "playback": {
            "mode": "lockstep",
            "steps": [{"trigger": "/joint_states", "answer": "/relayed"}],
        },
        "record": {"topics": ["/relayed"]},
        "output": {"uri": "pvc://results/out"},
    }  # fmt: skip
    spec = SimulationJobSpec.model_validate(patient(fields))
    context = RunContext("lab/read", spec, folders, "pvc://results/r", str(start_agent().shared))
    (case,) = plan(spec, Storage(folders)).cases
    row = run_case(case, context)
    assert row["outcome"] == "passed", row
    path = Path(folders["results"], "r", row["recorded"])
    expected = by_bagpipe(path)
    assert len(expected) == MESSAGES
    # The relay passes the bytes on as they are.
    played = sorted(each.checksum for each in by_rosbags(fetch()))
    assert sorted(each.checksum for each in expected) == played
    assert MemoryBag.open(path).chunk_count > 1
    assert_all_read(readers, {path: expected})
