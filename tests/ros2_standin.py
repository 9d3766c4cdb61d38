"""The stand-in of ROS 2 (tests/ros2) and the endpoint over Fast DDS (tests/ros2/fastdds), each
built once for each state of its sources.

`python3 -m tests.ros2_standin fastdds` builds the endpoint, and prints the folder that it is in.
"""

import os
import subprocess
import sys
from functools import partial
from pathlib import Path

from tests.cached import made_once, state_of

SOURCES = Path(__file__).parent / "ros2"
_BUILD_SECONDS = 300.0


def built() -> Path:
    """The folder that LD_LIBRARY_PATH names, as a sourced setup names the real one's."""
    return _built("standin", SOURCES, "cyclonedds-dev")


def fastdds() -> Path:
    """The folder with `fastdds_endpoint`."""
    return _built("fastdds", SOURCES / "fastdds", "libfastrtps-dev")


def _built(name: str, sources: Path, package: str) -> Path:
    state = state_of([path for path in sources.iterdir() if path.is_file()])
    return made_once(f"ros2-{name}", state, partial(_build, sources, package))


def _build(sources: Path, package: str, folder: Path) -> None:
    command = ["make", "--silent", "-C", str(sources), f"INTO={folder}"]
    environment = {name: value for name, value in os.environ.items() if name != "MAKEFLAGS"}
    done = subprocess.run(
        command,
        env=environment,
        capture_output=True,
        text=True,
        timeout=_BUILD_SECONDS,
        check=False,
    )
    assert done.returncode == 0, f"is Debian's {package} installed? {done.stderr}"


def environment(folder: Path) -> dict[str, str]:
    """What a sourced setup would set."""
    return {"LD_LIBRARY_PATH": str(folder), "AMENT_PREFIX_PATH": str(SOURCES)}


if __name__ == "__main__":
    if sys.argv[1:] != ["fastdds"]:
        sys.exit("usage: python3 -m tests.ros2_standin fastdds")
    print(fastdds())
