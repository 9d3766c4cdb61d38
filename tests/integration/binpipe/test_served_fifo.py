"""`fifo=` on a real Spark: programs that something else keeps running serve the named pipes."""

import os
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from pyspark import SparkContext
from pyspark.errors import PySparkException

import bagpipe
from tests.integration.conftest import RunningAgent

# Starts once, which is what such a program is for, and says in each record who it is and how
# many sessions it has served.
SERVE = """
import hashlib, os, sys
from bagpipe.binpipe import Pipe
sessions = 0
while True:
    with Pipe.over_fifos(*sys.argv[1:]) as pipe:
        sessions += 1
        for record in pipe.read():
            digest = hashlib.sha256(record.read()).hexdigest().encode()
            pipe.write(digest, name=record.name, server=os.getpid(), session=sessions)
"""


@pytest.fixture
def serve() -> Iterator[Callable[[Path], int]]:
    """Serve a folder's pair of FIFOs by a program; gives its process."""
    programs: list[subprocess.Popen[bytes]] = []

    def start(folder: Path) -> int:
        folder.mkdir(parents=True)
        pair = [folder / "to-agent", folder / "from-agent"]
        for fifo in pair:
            os.mkfifo(fifo)
        (folder / "lease").touch()
        programs.append(subprocess.Popen([sys.executable, "-c", SERVE, *map(str, pair)]))
        return programs[-1].pid

    yield start
    for program in programs:
        assert program.poll() is None, "it was to serve until it is stopped"
        program.kill()
        program.wait(timeout=10)


def digests(files: Path) -> dict[str, bytes]:
    """What the programs must answer, by another program's word."""
    output = subprocess.run(
        ["sha256sum", *files.glob("*.bin")], capture_output=True, check=True, timeout=20
    ).stdout
    lines = (line.split(maxsplit=1) for line in output.decode().splitlines())
    return {f"file://{path}": digest.encode() for digest, path in lines}


def test_one_program_serves_the_partitions_of_all_tasks_one_after_the_other(
    context: SparkContext, files: Path, tmp_path: Path, serve: Callable[[Path], int]
) -> None:
    folder = tmp_path / "pair"
    server = serve(folder)
    pair = (str(folder / "to-agent"), str(folder / "from-agent"))
    for run in range(2):
        piped = bagpipe.bin_piped(context, f"{files}/*.bin", fifo=pair, partitions=5, timeout=120)
        records = piped.collect_records()
        assert {record.name: record.data for record in records} == digests(files)
        assert {record.fields["server"] for record in records} == {server}
        # Two tasks at a time wanted the one pair of pipes: each had a session of its own.
        sessions = {int(record.fields["session"]) for record in records}
        assert sessions == {run * 5 + n for n in range(1, 6)}


def test_a_folder_of_slots_is_shared_by_as_many_tasks(
    context: SparkContext, files: Path, tmp_path: Path, serve: Callable[[Path], int]
) -> None:
    servers = {serve(tmp_path / "served/slots" / name) for name in ("0", "1")}
    piped = bagpipe.bin_piped(
        context, f"{files}/*.bin", fifo=str(tmp_path / "served"), partitions=6, timeout=120
    )
    saved = piped.save_as_binary_files(f"file://{tmp_path}/out")
    assert len(saved.records) == 9
    assert {record.fields["server"] for record in saved.records} <= servers
    stored = {r.name: Path(saved.location(r).removeprefix("file://")) for r in saved.records}
    assert {name: path.read_bytes() for name, path in stored.items()} == digests(files)


@pytest.mark.integration
def test_an_agents_slots_run_cases_and_say_so(
    context: SparkContext, files: Path, start_agent: Callable[..., RunningAgent]
) -> None:
    agent = start_agent(slots=2)
    piped = bagpipe.bin_piped(context, f"{files}/*.bin", fifo=str(agent.shared), timeout=60)
    with pytest.raises(PySparkException, match="ProtocolError: HELLO has no case, and an agent"):
        piped.count()
    agent.await_no_descendants()
