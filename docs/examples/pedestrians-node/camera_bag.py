"""Photographs as a camera's frames: writes a bag of sensor_msgs/CompressedImage.

    pip install rosbags
    python3 camera_bag.py street.bag PHOTOGRAPH.jpg [PHOTOGRAPH.jpg ...]

Each photograph is shown for FRAMES frames, at RATE frames a second, on TOPIC.
"""

import sys
from pathlib import Path

import numpy as np
from rosbags.rosbag1 import Writer
from rosbags.typesys import Stores, get_typestore

TOPIC, FRAMES, RATE = "/camera/image/compressed", 10, 10
KIND = "sensor_msgs/msg/CompressedImage"
BEGIN = 1_700_000_000  # seconds: any time will do that is not zero


def write(path: Path, photographs: list[Path]) -> int:
    """Writes the bag and gives the number of its frames."""
    store = get_typestore(Stores.ROS1_NOETIC)
    types = store.types
    with Writer(path) as bag:
        camera = bag.add_connection(TOPIC, KIND, typestore=store)
        number = 0
        for photograph in photographs:
            data = np.frombuffer(photograph.read_bytes(), np.uint8)
            for _ in range(FRAMES):
                time = BEGIN * 10**9 + number * 10**9 // RATE
                stamp = types["builtin_interfaces/msg/Time"](*divmod(time, 10**9))
                header = types["std_msgs/msg/Header"](seq=number, stamp=stamp, frame_id="camera")
                frame = types[KIND](header=header, format="jpeg", data=data)
                bag.write(camera, time, store.serialize_ros1(frame, KIND))
                number += 1
    return number


if __name__ == "__main__":
    print(write(Path(sys.argv[1]), [Path(name) for name in sys.argv[2:]]), "frames")
