"""Writes and reads bags with the package `rosbags`, as JSON lines.

Arguments: PAYLOAD FOLDER SCALE.
"""

import json
import sys
import time
from pathlib import Path

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
    say("write", count / (time.perf_counter() - start))
    start = time.perf_counter()
    with Reader(path) as reader:
        found = sum(1 for _ in reader.messages())
    say("read", count / (time.perf_counter() - start))
    path.unlink()
    assert found == count, found


def say(metric: str, value: float) -> None:
    row = {"case": "1 KB", "metric": metric, "unit": "msg/s", "by": "rosbags, disk", "value": value}
    print(json.dumps(row), flush=True)


if __name__ == "__main__":
    main()
