"""Writes and reads bags with bagpipe.MemoryBag from Python, as JSON lines.

Arguments: PAYLOAD FOLDER SCALE. Messages, counts and loops are those of rosbags_python.py; "from a
file" opens and reads a file as that does, the other way has the bag in memory already.
"""

import json
import sys
import time
from pathlib import Path

from bagpipe import MemoryBag

MD5SUM = "992ce8a1687cec8c8bd883ec73ca41d1"


def main() -> None:
    payload = Path(sys.argv[1]).read_bytes()
    path = Path(sys.argv[2]) / "memory.bag"
    size, count = 1024, max(1, int(100_000 * float(sys.argv[3])))
    distinct = len(payload) // size
    messages = [payload[at * size : (at + 1) * size] for at in range(min(count, distinct))]
    start = time.perf_counter()
    writer = MemoryBag.writer()
    for number in range(count):
        writer.write(
            "/chatter",
            1_700_000_000_000_000_000 + number * 1_000_000,
            messages[number % len(messages)],
            type="std_msgs/String",
            md5sum=MD5SUM,
            definition="string data\n",
        )
    bag = writer.finish()
    say("write from Python", count / (time.perf_counter() - start))
    data = bag.to_bytes()
    path.write_bytes(data)
    start = time.perf_counter()
    found = sum(1 for _ in MemoryBag(data).messages())
    say("read from Python", count / (time.perf_counter() - start))
    start = time.perf_counter()
    found += sum(1 for _ in MemoryBag.open(path).messages())
    say("read from Python, from a file", count / (time.perf_counter() - start))
    path.unlink()
    assert found == 2 * count, found


def say(metric: str, value: float) -> None:
    row = {"case": "1 KB", "metric": metric, "unit": "msg/s", "by": "bagpipe", "value": value}
    print(json.dumps(row), flush=True)


if __name__ == "__main__":
    main()
