"""ROS 2's own libraries from PyPI: rclpy, librcl and Fast DDS of Jazzy, in a folder of their own.

The wheels are a third party's (https://github.com/ycheng517/ros-python-wheels), each pinned by its
hashes in wheels.txt: what nodes need to run, none of what builds packages, and no rclcpp.

`python3 -m tests.ros2_rclpy.wheels` installs them, and prints the folder that they are in.
"""

import subprocess
import sys
import sysconfig
from pathlib import Path

from tests.cached import made_once

PINNED = Path(__file__).with_suffix(".txt")
_INSTALL_SECONDS = 600.0


def installed() -> Path:
    """What /opt/ros/jazzy is to who sources it, installed once for each state of what is pinned."""
    return made_once("rclpy", PINNED.read_bytes() + sys.version.encode(), _install)


def _install(folder: Path) -> None:
    subprocess.run([sys.executable, "-m", "venv", folder], check=True, timeout=_INSTALL_SECONDS)
    command = [str(folder / "bin/python"), "-m", "pip", "install", "--quiet", "--no-deps"]
    command += ["--disable-pip-version-check", "--require-hashes", "--only-binary", ":all:"]
    subprocess.run([*command, "-r", str(PINNED)], check=True, timeout=_INSTALL_SECONDS)


def environment(folder: Path) -> dict[str, str]:
    """What a sourced setup would set: Python finds all of it, and no other program does."""
    return {
        "LD_LIBRARY_PATH": str(folder / "lib"),
        "AMENT_PREFIX_PATH": str(folder),
        "ROS_DISTRO": "jazzy",
        "RMW_IMPLEMENTATION": "rmw_fastrtps_cpp",
    }


def environment_for_all(folder: Path) -> dict[str, str]:
    """The same for programs that are not Python: with what the wheels bundle and Python's own.

    Raises:
        AssertionError: Python has no shared library here (Debian's is in `libpython3.11`).
    """
    bundled = sorted(folder.glob("lib/python3.*/site-packages/*.libs"))
    python = Path(sysconfig.get_config_var("LIBDIR"), sysconfig.get_config_var("INSTSONAME"))
    there = ".so" in python.suffixes and python.exists()
    assert there, f"is Debian's libpython3.11 installed? There is no shared {python}"
    return environment(folder) | {
        "LD_LIBRARY_PATH": ":".join(map(str, [folder / "lib", *bundled])),
        "LD_PRELOAD": str(python),
    }


def python(folder: Path) -> str:
    """The interpreter that has rclpy."""
    return str(folder / "bin/python")


if __name__ == "__main__":
    print(installed())
