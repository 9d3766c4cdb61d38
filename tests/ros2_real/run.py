"""`make test-ros2`: the engine ros2 under a real ROS 2.

    python -m tests.ros2_real.run [PYTEST'S OPTIONS]

The exit status is pytest's.
"""

import json
import os
import subprocess
import sys

from tests.ros2_real import place


def main(options: list[str]) -> int:
    """Runs pytest in an environment that a sourced ROS 2 has no part in."""
    place.found()
    environment = dict(os.environ)
    kept = {name: environment.pop(name) for name in place.SOURCED if name in environment}
    environment[place.KEPT] = json.dumps(kept)
    # The checkout's own packages, whichever the environment has.
    packages = (place.ROOT / "images/spark/src", place.ROOT / "operator/src")
    environment["PYTHONPATH"] = os.pathsep.join(map(str, packages))
    command = [sys.executable, "-m", "pytest", "tests/ros2_real", *options]
    return subprocess.run(command, cwd=place.ROOT, env=environment, check=False).returncode


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
