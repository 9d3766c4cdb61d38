"""Whether a machine has a ROS 2 for the agent's player, which loads the client library itself."""

import ctypes.util
import os
from collections.abc import Mapping
from pathlib import Path

LIBRARY = "librcl.so"


def is_sourced(environment: Mapping[str, str]) -> bool:
    """Whether processes with this environment find a ROS 2."""
    if environment.get("AMENT_PREFIX_PATH"):
        return True
    folders = environment.get("LD_LIBRARY_PATH", "").split(os.pathsep)
    if any(Path(folder, LIBRARY).exists() for folder in folders if folder):
        return True
    return ctypes.util.find_library("rcl") is not None
