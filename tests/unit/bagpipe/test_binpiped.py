"""The worker's end without Spark: deadlines, faults of any program, bounds, FIFOs, packing."""

import os
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from types import SimpleNamespace

import pytest

from bagpipe.binpiped.exchange import exchange
from bagpipe.binpiped.failure import BinPipedError
from bagpipe.binpiped.logic import Command, Deadlines, Fifos, Logic, Slots
from bagpipe.binpiped.partition import PartitionRun
from bagpipe.binpiped.planning import Descriptor, fragments, pack, partitions_for, whole_files
from bagpipe.binpiped.record import InputRecord
from bagpipe.plan.bag_tail import MAGIC
from bagpipe.storage import Storage, StorageError
from bagpipe.storage.local import LocalBackend
from bagpipe.wire.frames import Encoder, FrameType
from tests.binpipe_conformance import DEADLINES, record
from tests.unit.bagpipe.bags import Recorded, write_bag
from tests.unit.bagpipe.fake_agent import make_slot
from tests.waiting import PATIENCE, wait_until

PATH = (("PYTHONPATH", os.pathsep.join(sys.path)),)
EACH = "from bagpipe import binpipe\nfor r in binpipe.read():\n "


def python(code: str) -> Command:
    return Command((sys.executable, "-c", code), PATH)


def shell(script: str) -> Command:
    return Command(("/bin/sh", "-c", script))


def failure(
    command: Logic, inputs: Iterable[InputRecord], deadlines: Deadlines = DEADLINES
) -> BinPipedError:
    with pytest.raises(BinPipedError) as failed:
        list(exchange(command, inputs, deadlines))
    return failed.value


def test_a_program_that_is_not_there_is_named() -> None:
    error = failure(Command(("/no/such/program",)), [record("a")])
    assert error.reason == "CannotStart"
    assert "/no/such/program" in str(error)


def test_output_that_is_no_frame_is_reported_with_what_to_do() -> None:
    error = failure(shell("echo hello world, this is a log line; cat > /dev/null"), [record("a")])
    assert error.reason == "ProtocolError"
    assert "print to stderr" in str(error)
    assert "68656c6c" in str(error)


@pytest.mark.parametrize(
    ("code", "message"),
    [
        ("binpipe.write(b'x', name='q'); p = binpipe._standard(); p._bytes += 1", "END says"),
        ("p = binpipe._standard(); p._output.digest ^= 1", "END says"),
        ("binpipe._standard()._output.send(3, b'x')", "DATA where FILE"),
        ("binpipe._standard()._output.send(4, b'\\x80')", "RESULT where FILE"),
        ("p = binpipe._standard(); p._begin('q', 5, {}); p.send_data(b'1234')", "after 4 of 5"),
        ("p = binpipe._standard(); p._begin('q', 3, {}); p.send_data(b'1234')", "above the 3"),
    ],
)
def test_a_breach_of_the_protocol_is_named(code: str, message: str) -> None:
    error = failure(python(EACH + code), [record("a")])
    assert error.reason == "ProtocolError"
    assert message in str(error)


def test_input_that_nobody_asked_for_is_a_failure() -> None:
    code = "from bagpipe import binpipe\nnext(binpipe.read()); binpipe.write(b'x')"
    error = failure(python(code), [record("a"), record("b")])
    assert error.reason == "InputLeft"


def test_an_end_that_does_not_prove_the_input_is_a_failure() -> None:
    code = EACH + "pass\nbinpipe._standard()._input_digest ^= 1"
    assert failure(python(code), [record("a")]).reason == "InputLeft"


def test_an_exception_of_the_program_is_reported_with_its_traceback() -> None:
    error = failure(python(EACH + "raise ValueError('no lane in ' + r.name)"), [record("a")])
    assert "ValueError: no lane in a" in str(error)
    assert error.stderr[0].startswith("Traceback")


def test_what_is_kept_of_stderr_is_bounded() -> None:
    code = EACH + "import sys; [print('x' * 10_000, n, file=sys.stderr) for n in range(500)]; 1/0"
    error = failure(python(code), [record("a")])
    assert len(error.stderr) == 20
    assert sum(map(len, error.stderr)) <= 20 * 500


def test_a_program_that_works_too_long_on_a_record_is_killed_with_its_children(
    tmp_path: Path,
) -> None:
    mark = tmp_path / "child"
    code = (
        "import subprocess\nfrom bagpipe import binpipe\nnext(binpipe.read())\n"
        "child = subprocess.Popen(['sleep', '600'])\n"
        f"open({str(mark)!r}, 'w').write(str(child.pid))\n"
        "child.wait()"
    )

    def inputs() -> Iterator[InputRecord]:
        yield record("a", bytes(300_000))  # more than waits for others to go with it
        wait_until(lambda: mark.exists() and mark.read_text() != "", PATIENCE, "no program began")
        yield record("b")

    error = failure(python(code), inputs(), Deadlines(200, record=5))
    assert error.reason == "RecordDeadlineExceeded"
    assert "5 s (record_timeout=)" in str(error)
    wait_until(lambda: not alive(int(mark.read_text())), PATIENCE, "the program goes on")


def test_a_partition_has_a_deadline_however_busy_the_program_is() -> None:
    code = EACH + "pass\nwhile True: binpipe.write(b'x' * 1000); binpipe.flush()"
    error = failure(python(code), [record("a")], Deadlines(partition=2, record=30))
    assert error.reason == "DeadlineExceeded"


def test_a_stdout_that_stays_open_after_the_end_is_not_waited_for(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr("bagpipe.binpiped.exchange.SILENCE_SECONDS", 0.5)
    # The child takes stdout along before the SDK puts it aside.
    forks = "import os\nif os.fork() == 0: os.execvp('sleep', ['sleep', '600'])\n"
    error = failure(python(forks + EACH + "pass"), [])
    assert error.reason == "ProgramStuck"


def test_the_clock_stands_still_while_others_work_on_the_results(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    stream = exchange(
        python(EACH + "binpipe.write(b'x')\n binpipe.flush()"),
        [record(str(n)) for n in range(4)],
        DEADLINES,
    )
    worked = 0.0
    clock = SimpleNamespace(monotonic=lambda: time.monotonic() + worked)
    monkeypatch.setattr("bagpipe.binpiped.exchange.time", clock)
    for _ in stream:
        worked += max(DEADLINES.partition, DEADLINES.record)
    assert worked > DEADLINES.partition


def test_an_iteration_that_ends_early_leaves_no_process_behind(tmp_path: Path) -> None:
    mark = tmp_path / "pid"
    code = f"import os; open({str(mark)!r}, 'w').write(str(os.getpid()))\n" + EACH
    stream = exchange(
        python(code + "binpipe.write(b'x'); binpipe.flush()"),
        # More than the pipe holds: a program that has read them all may have ended by itself.
        (record(str(n)) for n in range(1_000_000)),
        DEADLINES,
    )
    next(stream)
    assert alive(int(mark.read_text()))
    stream.close()
    wait_until(lambda: not alive(int(mark.read_text())), PATIENCE, "the program goes on")


@pytest.mark.parametrize(("planned", "replaced"), [(10, 5), (10, 25), (0, 25)])
def test_storage_that_fails_in_a_record_ends_the_program(
    tmp_path: Path, planned: int, replaced: int
) -> None:
    (tmp_path / "a").write_bytes(b"A" * planned)
    (descriptor,) = whole_files(Storage({}), [str(tmp_path / "a")])
    (tmp_path / "a").write_bytes(b"B" * replaced)
    settings = PartitionRun(python(EACH + "binpipe.write(r.read())"), DEADLINES, Storage({}))
    with pytest.raises(StorageError, match="is no longer the file that was planned"):
        list(settings.records([descriptor]))


@pytest.mark.parametrize(
    ("become", "what"), [(os.mkfifo, "no regular file"), (os.mkdir, "a folder, not a file")]
)
def test_a_file_that_became_something_else_is_refused_rather_than_waited_for(
    tmp_path: Path, become: Callable[[Path], None], what: str
) -> None:
    (tmp_path / "a").write_bytes(b"A" * 10)
    (descriptor,) = whole_files(Storage({}), [str(tmp_path / "a")])
    (tmp_path / "a").unlink()
    become(tmp_path / "a")
    settings = PartitionRun(python(EACH + "binpipe.write(r.read())"), DEADLINES, Storage({}))
    with pytest.raises(StorageError, match=f"/a can't be read: it is {what}"):
        list(settings.records([descriptor]))


def test_a_small_file_is_asked_for_once(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "a").write_bytes(b"A" * 10)
    (descriptor,) = whole_files(Storage({}), [str(tmp_path / "a")])
    monkeypatch.delattr(LocalBackend, "stat")
    assert list(descriptor.open(Storage({})).pieces()) == [b"A" * 10]


def test_a_gibibyte_in_and_out_leaves_the_worker_small(tmp_path: Path) -> None:
    large = tmp_path / "large"
    with large.open("wb") as file:
        file.truncate(1 << 30)
    code = f"""
import resource, sys
from tests.unit.bagpipe.test_binpiped import *
settings = PartitionRun(python(EACH + "binpipe.write(r.pieces())"), DEADLINES, Storage({{}}))
before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
stream = settings.stream(whole_files(Storage({{}}), [{str(large)!r}]))
count = sum(len(item) for item in stream if isinstance(item, bytes))
print(count, resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before)
"""
    done = subprocess.run(
        [sys.executable, "-c", code], env=dict(PATH), capture_output=True, text=True, check=True
    )
    count, grown = map(int, done.stdout.split())
    assert count == 1 << 30
    assert grown < 24 << 10


SERVE = """
import sys
from bagpipe.binpipe import Pipe
while True:
    with Pipe.over_fifos(*sys.argv[1:]) as pipe:
        for r in pipe.read():
            pipe.write(r.read(), name=r.name + "!")
"""


@pytest.fixture
def served(tmp_path: Path) -> Iterator[Path]:
    """A slot whose FIFOs a program serves, one session after the other."""
    folder = make_slot(tmp_path)
    pipes = [str(folder / name) for name in ("to-agent", "from-agent")]
    program = subprocess.Popen([sys.executable, "-c", SERVE, *pipes], env=dict(PATH))
    yield tmp_path
    program.kill()
    program.wait()


def test_a_served_fifo_takes_one_session_after_the_other(served: Path) -> None:
    folder = served / "slots/0"
    pair = Fifos(str(folder / "to-agent"), str(folder / "from-agent"))
    for logic in (pair, Slots(str(served)), pair):
        items = list(exchange(logic, [record("a", b"1"), record("b", b"22")], DEADLINES))
        assert items[1::2] == [b"1", b"22"]


def test_tasks_wait_for_the_fifo_that_another_has(served: Path) -> None:
    folder = served / "slots/0"
    pair = Fifos(str(folder / "to-agent"), str(folder / "from-agent"))
    found: list[list[object]] = []

    def work() -> None:
        found.append(list(exchange(pair, [record("a", b"1")], DEADLINES)))

    threads = [threading.Thread(target=work, daemon=True) for _ in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join(60)
    assert [items[1::2] for items in found] == [[b"1"]] * 4


def test_what_a_dead_session_left_in_the_fifo_is_thrown_away(tmp_path: Path) -> None:
    folder = make_slot(tmp_path)
    session = Encoder().encode_fields(FrameType.HELLO, {"session": "old", "protocol": 1})
    code = SERVE.replace("while True:", "if True:").replace(
        "        for r",
        f"        import os; os.write(pipe._output._descriptor, {session!r})\n        for r",
    )
    pipes = [str(folder / name) for name in ("to-agent", "from-agent")]
    program = subprocess.Popen([sys.executable, "-c", code, *pipes], env=dict(PATH))
    items = list(exchange(Fifos(*pipes), [record("a", b"1")], DEADLINES))
    assert items[1::2] == [b"1"]
    assert program.wait(90) == 0


def test_a_fifo_that_nobody_serves_is_reported_within_its_deadline(tmp_path: Path) -> None:
    make_slot(tmp_path)
    error = failure(Slots(str(tmp_path)), [record("a")], Deadlines(partition=0.5, record=1))
    assert error.reason == "NobodyServes"


def test_partitions_have_about_equal_bytes_and_the_biggest_first() -> None:
    sizes = [900, 10, 300, 300, 300, 10, 5, 0, 0]
    descriptors = [Descriptor(f"r{n}", "u", ((0, s),)) for n, s in enumerate(sizes)]
    packed = pack(descriptors, 2)
    assert [sum(d.size for d in part) for part in packed] == [915, 910]
    assert packed[0][0].size == 900
    assert sorted(d.name for part in packed for d in part) == [f"r{n}" for n in range(9)]
    assert len(pack(descriptors, 100)) == 9
    assert partitions_for([Descriptor("r", "u", ((0, 1 << 30),))], 2) == 8


def test_a_bag_becomes_fragments_that_are_bags(tmp_path: Path) -> None:
    bag = write_bag(
        tmp_path / "a.bag",
        (Recorded("/a", 1 + n * 100_000_000, "x" * 100) for n in range(400)),
        chunk_bytes=4096,
    )
    found = fragments(Storage({}), [str(bag)], 10, ["/a"])
    assert [descriptor.name for descriptor in found] == [f"file://{bag}#{n}" for n in range(4)]
    for descriptor in found:
        opened = descriptor.open(Storage({}))
        data = b"".join(opened.pieces())
        assert len(data) == opened.size
        assert data.startswith(MAGIC)
        assert opened.fields["end"] - opened.fields["start"] > 7_000_000_000  # type: ignore[operator]


def test_a_bag_that_was_replaced_since_it_was_planned_is_no_record(tmp_path: Path) -> None:
    planned = write_bag(tmp_path / "a.bag", [Recorded("/a", 1, "x")])
    (descriptor,) = fragments(Storage({}), [str(planned)], 10, ["/a"])
    write_bag(tmp_path / "b.bag", [Recorded("/a", 1, "y" * 1000)]).replace(planned)
    with pytest.raises(StorageError, match="is no longer the file that was planned"):
        list(descriptor.open(Storage({})).pieces())


def test_files_are_found_by_glob_and_by_path(tmp_path: Path) -> None:
    for name in ("b.bin", "a.bin", "c.txt"):
        (tmp_path / name).write_bytes(b"1")
    found = whole_files(Storage({}), [f"{tmp_path}/*.bin", str(tmp_path / "c.txt")])
    assert [d.uri.rpartition("/")[2] for d in found] == ["a.bin", "b.bin", "c.txt"]


def alive(pid: int) -> bool:
    try:
        state = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0]
    except OSError:
        return False
    return state != "Z"


def test_a_worker_loads_nothing_of_jobs() -> None:
    """Each Python worker of Spark loads these modules before its first record."""
    code = "import sys, bagpipe.binpiped; print(*sys.modules)"
    done = subprocess.run(
        [sys.executable, "-c", code],
        env={**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)},
        capture_output=True,
        text=True,
        timeout=60,
        check=True,
    )
    loaded = set(done.stdout.split())
    assert "bagpipe.binpiped.partition" in loaded
    assert loaded & {"bagpipe.spec", "bagpipe.run", "pydantic", "celpy", "fsspec"} == set()
