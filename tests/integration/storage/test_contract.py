"""What every kind of storage promises, over folders, a claim, a real S3 and a real HDFS."""

import json
import subprocess
import sys
import threading
from concurrent.futures import ThreadPoolExecutor

import pytest

from bagpipe.storage import StorageError
from tests.integration.storage.conftest import Place
from tests.waiting import PATIENCE, wait_until

MIB = 1 << 20
BIG = 20 * MIB + 12345
# What a process that has written and read 64 MiB may grow by with 192 MiB more: less than a part
# of them, and more than what allocators keep by chance.
MOST_GROWTH_MIB = 64


def pattern(length: int) -> bytes:
    """Bytes that differ wherever a range is off by anything but a multiple of 16,381."""
    block = bytes((n * 7919 + n // 251) % 256 for n in range(16381))
    return (block * (length // len(block) + 1))[:length]


def write(place: Place, name: str, data: bytes, step: int = MIB) -> str:
    uri = f"{place.uri}/{name}"
    with place.storage.create(uri) as file:
        for at in range(0, len(data), step):
            file.write(data[at : at + step])
    return uri


@pytest.mark.parametrize("length", [0, 1, 8 * MIB, BIG])
def test_what_is_written_is_read(place: Place, length: int) -> None:
    data = pattern(length)
    uri = write(place, "x.bag", data, 777_777)
    assert place.storage.size(uri) == length
    assert place.storage.read_all(uri, BIG) == data
    assert place.storage.names(place.uri) == ["x.bag"]


def test_ranges_come_in_order_and_in_pieces(place: Place) -> None:
    data = pattern(BIG)
    uri = write(place, "x.bag", data)
    ranges = [(BIG - 50, 50), (0, 10), (20, 5), (5 * MIB - 3, 9 * MIB), (7, 0)]
    pieces = list(place.storage.pieces(uri, ranges, MIB))
    assert b"".join(pieces) == b"".join(data[at : at + length] for at, length in ranges)
    assert max(map(len, pieces)) <= MIB
    assert place.storage.read(uri, BIG - 4, 100) == data[-4:]


def test_a_file_appears_whole_or_not_at_all(place: Place) -> None:
    for length in (10, BIG):
        with pytest.raises(ZeroDivisionError), place.storage.create(f"{place.uri}/x.bag") as file:
            file.write(pattern(length))
            assert not place.storage.exists(f"{place.uri}/x.bag")
            raise ZeroDivisionError
    assert place.storage.names(place.uri) == []
    write(place, "x.bag", b"first")
    with pytest.raises(ZeroDivisionError), place.storage.create(f"{place.uri}/x.bag") as file:
        file.write(b"second")
        raise ZeroDivisionError
    assert place.storage.read_all(f"{place.uri}/x.bag", 10) == b"first"
    write(place, "x.bag", b"third")
    assert place.storage.read_all(f"{place.uri}/x.bag", 10) == b"third"


def test_one_of_eight_threads_puts(place: Place) -> None:
    for turn in range(5):
        uri = f"{place.uri}/manifest-{turn}.json"
        gate = threading.Barrier(8)

        def put(number: int, uri: str = uri, gate: threading.Barrier = gate) -> bool:
            gate.wait(PATIENCE)
            return place.storage.put_once(uri, bytes([number]) * 1000)

        with ThreadPoolExecutor(8) as writers:
            won = list(writers.map(put, range(8)))
        assert won.count(True) == 1
        assert place.storage.read_all(uri, 1000) == bytes([won.index(True)]) * 1000
    assert place.storage.names(place.uri) == [f"manifest-{turn}.json" for turn in range(5)]


_PUTTER = """
import json, sys
from bagpipe.storage import Storage
uri, volumes, number = sys.argv[1], json.loads(sys.argv[2]), sys.argv[3]
storage = Storage(volumes)
storage.exists(uri)
print("ready", flush=True)
for turn in sys.stdin:
    print(storage.put_once(uri + turn.strip(), number.encode() * 1000), flush=True)
"""


def test_one_of_two_processes_puts(place: Place) -> None:
    volumes = json.dumps(place.storage.volumes)
    commands = [
        [sys.executable, "-c", _PUTTER, f"{place.uri}/manifest-", volumes, number]
        for number in "01"
    ]
    putters = [
        subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
        for command in commands
    ]
    try:
        assert [p.stdout.readline() for p in putters if p.stdout] == ["ready\n"] * 2
        for turn in range(10):
            for putter in putters:
                assert putter.stdin
                putter.stdin.write(f"{turn}\n")
                putter.stdin.flush()
            won = [p.stdout.readline().strip() for p in putters if p.stdout]
            assert sorted(won) == ["False", "True"]
            uri = f"{place.uri}/manifest-{turn}"
            assert place.storage.read_all(uri, 1000) == str(won.index("True")).encode() * 1000
    finally:
        for putter in putters:
            putter.communicate(timeout=PATIENCE)


def test_wildcards_find_files_sorted(place: Place) -> None:
    for name in ("b.bag", "a.bag", "sub/deep/c.bag", "sub/d.bag", "note.txt"):
        write(place, name, b"x")
    found = {
        "*.bag": ["a.bag", "b.bag"],
        "?.txt": [],
        "[b-z].bag": ["b.bag"],
        "*/*.bag": ["sub/d.bag"],
        "**/*.bag": ["a.bag", "b.bag", "sub/d.bag", "sub/deep/c.bag"],
        "sub/deep/c.bag": ["sub/deep/c.bag"],
        "sub": [],
        "none/*.bag": [],
    }
    for wildcard, names in found.items():
        expected = [f"{place.uri}/{name}" for name in names]
        assert place.storage.expand(f"{place.uri}/{wildcard}") == expected, wildcard
    assert place.storage.names(place.uri) == ["a.bag", "b.bag", "note.txt", "sub"]
    assert place.storage.names(f"{place.uri}/none") == []


def test_removing_twice_is_no_error(place: Place) -> None:
    uri = write(place, "x.bag", b"x")
    assert place.storage.exists(uri)
    place.storage.remove(uri)
    place.storage.remove(uri)
    assert not place.storage.exists(uri)
    with pytest.raises(StorageError, match=r"x\.bag can't be read: [Nn]o such file"):
        place.storage.read(uri, 0, 1)


def test_a_bag_that_changed_since_it_was_planned_is_refused(place: Place) -> None:
    uri = write(place, "x.bag", pattern(5 * MIB))
    file = place.storage.open(uri)
    assert file.read(0, 4) == pattern(4)

    def changed() -> bool:
        # Web servers give the time of a change in whole seconds, HDFS in milliseconds.
        write(place, "x.bag", b"other" * MIB)
        return place.storage.open(uri).version != file.version

    wait_until(changed, PATIENCE, "the version never changed")
    with pytest.raises(StorageError, match="is no longer the file that was planned"):
        file.read(0, 4)
    with pytest.raises(StorageError, match="is no longer the file that was planned"):
        list(place.storage.pieces(uri, [(0, 4)], 4, file.version))


_GROWTH = """
import json, resource, sys
from bagpipe.storage import Storage
uri, volumes = sys.argv[1], json.loads(sys.argv[2])
storage = Storage(volumes)
piece = bytes(1 << 20)
def turn(count):
    with storage.create(uri) as file:
        for _ in range(count):
            file.write(piece)
    return sum(map(len, storage.pieces(uri, [(0, count << 20)], 1 << 20)))
turn(64)
before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
assert turn(192) == 192 << 20
print((resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before) // 1024)
"""


def test_memory_stays_flat_over_a_big_file(place: Place) -> None:
    command = [sys.executable, "-c", _GROWTH, f"{place.uri}/big.bag"]
    done = subprocess.run(
        [*command, json.dumps(place.storage.volumes)],
        capture_output=True,
        text=True,
        timeout=400,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    assert int(done.stdout) < MOST_GROWTH_MIB, f"grew by {done.stdout} MiB"
