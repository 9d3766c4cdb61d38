"""Writes a bag of std_msgs/String with Debian's rosbag: make_bag.py <file> <bytes> <messages>.

The messages come 100 microseconds apart; a chunk holds 16 MiB.
"""

import sys

import genpy
import rosbag
from std_msgs.msg import String

path, size, messages = sys.argv[1], int(sys.argv[2]), int(sys.argv[3])
body = (size - 4).to_bytes(4, "little") + b"x" * (size - 4)
kind = (String._type, body, String._md5sum, String)
with rosbag.Bag(path, "w", chunk_threshold=16 << 20) as bag:
    for number in range(messages):
        nanoseconds = 1_000_000_000 + number * 100_000
        time = genpy.Time(nanoseconds // 10**9, nanoseconds % 10**9)
        bag.write("/data", kind, time, raw=True)
