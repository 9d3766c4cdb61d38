"""Writes and reads bags with the package `rosbags`, as JSON lines.

Arguments: PAYLOAD FOLDER SCALE LIST; LIST has lines of a case's name, a tab and the path of a bag
that is read and written again.
"""

import json
import sys
import time
from pathlib import Path

from rosbags.interfaces import Connection
from rosbags.rosbag1 import Reader, Writer

MD5SUM = "992ce8a1687cec8c8bd883ec73ca41d1"


def main() -> None:
    payload = Path(sys.argv[1]).read_bytes()
    path = Path(sys.argv[2]) / "rosbags.bag"
    size, count = 1024, max(1, int(100_000 * float(sys.argv[3])))
    distinct = len(payload) // size
    messages = [payload[at * size : (at + 1) * size] for at in range(min(count, distinct))]
    start = time.perf_counter()
    with Writer(path) as writer:
        connection = writer.add_connection(
            "/chatter", "std_msgs/msg/String", msgdef="string data\n", md5sum=MD5SUM
        )
        for number in range(count):
            moment = 1_700_000_000_000_000_000 + number * 1_000_000
            writer.write(connection, moment, messages[number % len(messages)])
    say("1 KB", "write", "msg/s", count / (time.perf_counter() - start))
    start = time.perf_counter()
    with Reader(path) as reader:
        found = sum(1 for _ in reader.messages())
    say("1 KB", "read", "msg/s", count / (time.perf_counter() - start))
    path.unlink()
    assert found == count, found
    for line in Path(sys.argv[4]).read_text().splitlines():
        name, bag = line.split("\t")
        again(name, Path(bag), path)


def again(name: str, path: Path, made: Path) -> None:
    """A bag is read, and written, so often that it is at least 32 MiB, but at most 20 times."""
    with Reader(path) as reader:
        kept = [
            (connection.id, moment, bytes(raw)) for connection, moment, raw in reader.messages()
        ]
        connections = list(reader.connections)
    size = sum(len(raw) for _, _, raw in kept)
    times = min(20, max(1, (32 << 20) // size))
    start = time.perf_counter()
    for _ in range(times):
        with Reader(path) as reader:
            found = sum(1 for _ in reader.messages())
    say(name, "read", "MB/s", size * times / 1e6 / (time.perf_counter() - start))
    assert found == len(kept), found
    start = time.perf_counter()
    for _ in range(times):
        write(name, connections, kept, made)
        made.unlink()
    say(name, "write", "MB/s", size * times / 1e6 / (time.perf_counter() - start))


def write(
    name: str, connections: list[Connection], kept: list[tuple[int, int, bytes]], path: Path
) -> None:
    writer = Writer(path)
    for packing in Writer.CompressionFormat:
        if packing.name.lower() in name:
            writer.set_compression(packing)
    with writer:
        known: dict[tuple[str, str], Connection] = {}
        to: dict[int, Connection] = {}
        for each in connections:
            key = each.topic, each.digest
            if key not in known:
                known[key] = writer.add_connection(
                    each.topic, each.msgtype, msgdef=each.msgdef.data, md5sum=each.digest
                )
            to[each.id] = known[key]
        for identity, moment, raw in kept:
            writer.write(to[identity], moment, raw)


def say(case: str, metric: str, unit: str, value: float) -> None:
    row = {"case": case, "metric": metric, "unit": unit, "by": "rosbags, disk", "value": value}
    print(json.dumps(row), flush=True)


if __name__ == "__main__":
    main()
