"""A bag of 100 GB on S3 is planned with a few ranged reads: its tail is enough.

The file is as long as it says, but sparse: only its head and its index are written.
"""

import struct
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import pytest
import yaml
from click.testing import CliRunner

from bagpipe.cli.__main__ import main
from bagpipe.plan.bag_tail import MAGIC
from bagpipe.source.planning import plan
from bagpipe.storage import Storage
from bagpipe.storage.reading import REQUEST_BYTES
from tests.integration.storage.conftest import QUICK
from tests.integration.storage.faulty_proxy import FaultyProxy
from tests.integration.storage.servers import BUCKET, S3Server
from tests.unit.bagpipe.jobs import make_spec

GB = 1_000_000_000
CHUNK_BYTES = 1 << 20
CHUNKS = 100 * GB // CHUNK_BYTES
# 50 ms of a vehicle that records 20 MB/s, five messages of each of two topics.
CHUNK_NS = 50_000_000


def record(fields: dict[str, bytes], data: bytes = b"") -> bytes:
    """A record of bag 2.0: its header's fields, then its data, each with its length."""
    header = b"".join(
        struct.pack("<I", len(name) + 1 + len(value)) + name.encode() + b"=" + value
        for name, value in fields.items()
    )
    return struct.pack("<I", len(header)) + header + struct.pack("<I", len(data)) + data


def connection(number: int, topic: str) -> bytes:
    described = record({"topic": topic.encode(), "type": b"sensor_msgs/Image", "md5sum": b"*"})
    length = struct.unpack_from("<I", described)[0]
    header = {"op": b"\x07", "conn": struct.pack("<I", number), "topic": topic.encode()}
    return record(header, described[4 : 4 + length])


def time_of(nanoseconds: int) -> bytes:
    return struct.pack("<II", *divmod(nanoseconds, GB))


def chunk_info(number: int) -> bytes:
    begin = 1_000 * GB + number * CHUNK_NS
    header = {
        "op": b"\x06",
        "ver": struct.pack("<I", 1),
        "chunk_pos": struct.pack("<Q", 4117 + number * CHUNK_BYTES),
        "start_time": time_of(begin),
        "end_time": time_of(begin + CHUNK_NS - 1),
        "count": struct.pack("<I", 2),
    }
    return record(header, struct.pack("<IIII", 0, 5, 1, 5))


@dataclass(frozen=True)
class BigBag:
    uri: str
    size: int
    index_bytes: int


@pytest.fixture
def big_bag(s3: S3Server) -> Iterator[BigBag]:
    path = s3.root / BUCKET / "big" / "drive.bag"
    path.parent.mkdir(exist_ok=True)
    index = b"".join(
        [connection(0, "/camera"), connection(1, "/lidar"), *map(chunk_info, range(CHUNKS))]
    )
    index_position = 4117 + CHUNKS * CHUNK_BYTES
    header = {
        "op": b"\x03",
        "index_pos": struct.pack("<Q", index_position),
        "conn_count": struct.pack("<I", 2),
        "chunk_count": struct.pack("<I", CHUNKS),
    }
    with path.open("wb") as file:
        file.write(MAGIC + record(header))
        file.seek(index_position)
        file.write(index)
    yield BigBag(f"s3://{BUCKET}/big/drive.bag", index_position + len(index), len(index))
    path.unlink()


def test_a_bag_of_100_gb_is_planned_with_a_few_requests(
    big_bag: BigBag, proxy: FaultyProxy, s3: S3Server
) -> None:
    assert big_bag.size > 100 * GB - CHUNK_BYTES
    on_disk = Path(s3.root / BUCKET / "big" / "drive.bag").stat().st_blocks * 512
    assert on_disk < 50_000_000
    spec = make_spec(source={"bags": [big_bag.uri], "topics": ["/lidar"]})
    planned = plan(spec, Storage({}, QUICK))
    assert planned.unplanned == []
    # 95,367 chunks of 50 ms in fragments of 60 s.
    assert len(planned.cases) == -(-CHUNKS * CHUNK_NS // (60 * GB)) == 80
    assert sum(case.messages for case in planned.cases) == 5 * CHUNKS
    tail_requests = -(-big_bag.index_bytes // REQUEST_BYTES)
    # One HEAD finds the file, one gives its size and version; then its head, then its index.
    assert (proxy.count("HEAD"), proxy.count("GET")) == (2, 1 + tail_requests)
    assert tail_requests == 3
    assert proxy.ranges()[0] == "0-4172"
    read = sum(int(end) - int(begin) + 1 for begin, end in (r.split("-") for r in proxy.ranges()))
    assert read == 4173 + big_bag.index_bytes
    assert read < 15_000_000


def test_a_job_for_a_bag_of_100_gb_is_written_with_a_few_requests(
    big_bag: BigBag, proxy: FaultyProxy
) -> None:
    done = CliRunner().invoke(main, ["init", big_bag.uri, "--output", "/lidar"])
    assert done.exit_code == 0, done.output
    spec = yaml.safe_load(done.stdout)["spec"]
    assert spec["source"] == {
        "bags": [big_bag.uri],
        # 12 s of 20 MB each keep within 256 MiB, 22 s don't.
        "fragment": {"length": "10s", "warmUp": "2s"},
    }
    # Half of 100 a second: when they came would take a request for each of 95,367 chunks.
    assert spec["evaluate"] == [{"name": "lidar rate", "rate": {"topic": "/lidar", "min": 50.0}}]
    assert "# /lidar: no header with a stamp was seen, so no latency is demanded." in done.stdout
    tail_requests = -(-big_bag.index_bytes // REQUEST_BYTES)
    # The head and the index; the connections again, a chunk, which is sparse and no chunk at all,
    # and the head of that.
    assert proxy.count("GET") == 1 + tail_requests + 3
    read = sum(int(end) - int(begin) + 1 for begin, end in (r.split("-") for r in proxy.ranges()))
    assert read < 16_000_000
