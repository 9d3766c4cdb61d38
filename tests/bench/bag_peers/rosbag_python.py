"""Writes and reads bags with Debian's Python rosbag, as JSON lines; run by /usr/bin/python3.

Arguments: PAYLOAD FOLDER SCALE. Raw messages: nothing is deserialised, as in the other programs.
"""

import json
import sys
import time
from pathlib import Path
from typing import Any

import genpy  # type: ignore[import-not-found]
import rosbag  # type: ignore[import-not-found]

BY = "rosbag Python, disk"
MD5SUM = "992ce8a1687cec8c8bd883ec73ca41d1"


class String:
    """What rosbag asks of a message's class."""

    _type = "std_msgs/String"
    _md5sum = MD5SUM
    _full_text = "string data\n"


def main() -> None:
    payload = Path(sys.argv[1]).read_bytes()
    path = Path(sys.argv[2]) / "python.bag"
    size, count = 1024, max(1, int(50_000 * float(sys.argv[3])))
    distinct = len(payload) // size
    messages = [payload[at * size : (at + 1) * size] for at in range(min(count, distinct))]
    start = time.perf_counter()
    with rosbag.Bag(str(path), "w") as bag:
        for number in range(count):
            raw: Any = (String._type, messages[number % len(messages)], MD5SUM, String)
            bag.write("/chatter", raw, genpy.Time(1_700_000_000, number * 1000), raw=True)
    say("write", count / (time.perf_counter() - start))
    start = time.perf_counter()
    with rosbag.Bag(str(path)) as bag:
        found = sum(1 for _ in bag.read_messages(raw=True))
    say("read", count / (time.perf_counter() - start))
    path.unlink()
    assert found == count, found


def say(metric: str, value: float) -> None:
    row = {"case": "1 KB", "metric": metric, "unit": "msg/s", "by": BY, "value": value}
    print(json.dumps(row), flush=True)


if __name__ == "__main__":
    main()
