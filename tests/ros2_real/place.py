"""Where a real ROS 2 is: sourced on this machine, or in an image for docker or podman."""

import json
import os
import shutil
import subprocess
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

ROOT = Path(__file__).parents[2]
# What a sourced setup changes for every program, ours included: it is for ROS 2's alone.
SOURCED = ("LD_LIBRARY_PATH", "PYTHONPATH")
KEPT = "BAGPIPE_SOURCED"
# Those that a trial knows; each may need something of its own, as Zenoh a router.
RMWS = ("rmw_cyclonedds_cpp", "rmw_fastrtps_cpp")
_SECONDS = 600.0
_LIST = """IFS=:
for prefix in $AMENT_PREFIX_PATH; do ls "$prefix/share/ament_index/resource_index/$0"; done
"""
_ENTER = """
if [ -n "${ROS2_SETUP:-}" ]; then . "$ROS2_SETUP"; fi
if [ -n "$0" ]; then
  export AMENT_PREFIX_PATH="$0:$AMENT_PREFIX_PATH"
  export LD_LIBRARY_PATH="$0/lib:$LD_LIBRARY_PATH"
fi
exec "$@"
"""


class NowhereError(Exception):
    """There is no ROS 2 to try; the message says what to do."""


@dataclass(frozen=True)
class Place:
    """How programs are started where ROS 2 is."""

    image: str = ""
    engine: str = ""
    variables: Mapping[str, str] = field(default_factory=dict)

    def command(
        self, words: Sequence[str], nodes: Path | None = None, folders: Sequence[Path] = ()
    ) -> list[str]:
        """A command in its environment, with installed nodes in it; an image gets the checkout
        read-only, and `folders` to write into.
        """
        entered = ["-c", _ENTER, str(nodes or ""), *words]
        if not self.image:
            return ["bash", *entered]
        # Of the network its own loopback alone; shared memory as a pod's volume has it.
        command = [self.engine, "run", "--rm", "--network", "none", "--shm-size", "1g"]
        command += ["--entrypoint", "bash", "--volume", f"{ROOT}:{ROOT}:ro"]
        for folder in (*folders, *filter(None, [nodes])):
            command += ["--volume", f"{folder}:{folder}"]
        # Its distribution's name is in the image's own environment.
        setup = "${ROS2_SETUP:-/opt/ros/$ROS_DISTRO/setup.bash}"
        entered[1] = f"ROS2_SETUP={setup}\n{_ENTER}"
        return [*command, self.image, *entered]

    def environment(self) -> dict[str, str]:
        """What a command is started with."""
        return {**os.environ, **self.variables}

    def run(
        self, words: Sequence[str], nodes: Path | None = None, folders: Sequence[Path] = ()
    ) -> subprocess.CompletedProcess[str]:
        """Runs a command to its end, within ten minutes."""
        return subprocess.run(
            self.command(words, nodes, folders),
            env=self.environment(),
            capture_output=True,
            text=True,
            timeout=_SECONDS,
            check=False,
        )

    def rmws(self) -> list[str]:
        """The middlewares to try: those installed, or the one that RMW_IMPLEMENTATION names."""
        if named := os.environ.get("RMW_IMPLEMENTATION"):
            return [named]
        found = self.run(["bash", "-c", _LIST, "rmw_typesupport"]).stdout.split()
        return [name for name in RMWS if name in found]

    def has(self, package: str) -> bool:
        """Whether a package is installed."""
        return package in self.run(["bash", "-c", _LIST, "packages"]).stdout.split()


def found() -> Place:
    """The image that ROS2_IMAGE names, else what is sourced here."""
    if image := os.environ.get("ROS2_IMAGE"):
        return _in_image(image)
    if os.environ.get("AMENT_PREFIX_PATH"):
        return Place(variables=json.loads(os.environ.get(KEPT, "{}")))
    raise NowhereError(
        "There is no ROS 2 to test with: source its setup.bash (such as /opt/ros/jazzy/setup.bash),"
        " which sets AMENT_PREFIX_PATH, or name an image, as in `make test-ros2"
        " ROS2_IMAGE=ros:jazzy`, where there is docker or podman."
    )


def _in_image(image: str) -> Place:
    engine = next(filter(shutil.which, ("docker", "podman")), None)
    if engine is None:
        raise NowhereError(f"ROS2_IMAGE is {image}, and neither docker nor podman is on PATH.")
    there = subprocess.run([engine, "image", "inspect", image], capture_output=True, check=False)
    if there.returncode:
        got = subprocess.run([engine, "pull", image], capture_output=True, text=True, check=False)
        if got.returncode:
            raise NowhereError(f"{engine} can't have the image {image}: {got.stderr.strip()}")
    return Place(image, engine)


if __name__ == "__main__":
    try:
        found()
    except NowhereError as error:
        sys.exit(str(error))
