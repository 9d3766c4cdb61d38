"""The package of nodes in nodes/, built once for each state of it and each ROS 2."""

import fcntl
import hashlib
import os
import shutil
from pathlib import Path

from tests.ros2_real.place import Place

SOURCES = Path(__file__).parent / "nodes"
# A ROS 2 that was installed again has other libraries below the same path.
_WHICH = (
    'echo "$AMENT_PREFIX_PATH $(stat --dereference --format "%Y %s" $(printf "%s\\n"'
    ' ${AMENT_PREFIX_PATH//://lib/librclcpp.so }/lib/librclcpp.so) 2> /dev/null)"'
)
_BUILD = """set -e
cmake -S "$0" -B "$1/build" -DCMAKE_INSTALL_PREFIX="$1" -DCMAKE_BUILD_TYPE=RelWithDebInfo
cmake --build "$1/build" --parallel "$(nproc)"
cmake --install "$1/build"
rm -r "$1/build"
"""


def built(place: Place) -> Path:
    """The prefix where they are installed."""
    digest = hashlib.sha256(f"{place.image} {place.run(['bash', '-c', _WHICH]).stdout}".encode())
    for source in sorted(path for path in SOURCES.rglob("*") if path.is_file()):
        digest.update(source.read_bytes())
    cache = Path(os.environ.get("BAGPIPE_CACHE", Path.home() / ".cache/bagpipe"))
    prefix = cache / f"ros2-nodes-{digest.hexdigest()[:16]}"
    cache.mkdir(parents=True, exist_ok=True)
    with (cache / "ros2-nodes.lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        if not (prefix / "complete").exists():
            shutil.rmtree(prefix, ignore_errors=True)
            prefix.mkdir()
            # A prefix keeps its name: CMake writes it into what it installs.
            done = place.run(["bash", "-c", _BUILD, str(SOURCES), str(prefix)], folders=[prefix])
            assert done.returncode == 0, f"{done.stdout[-3000:]}\n{done.stderr[-3000:]}"
            (prefix / "complete").touch()
    return prefix
