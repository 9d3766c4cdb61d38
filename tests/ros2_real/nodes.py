"""The package of nodes in nodes/, built once for each state of it and each ROS 2."""

from functools import partial
from pathlib import Path

from tests.cached import made_once, state_of
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
    which = f"{place.image} {place.run(['bash', '-c', _WHICH]).stdout}".encode()
    state = which + state_of([path for path in SOURCES.rglob("*") if path.is_file()])
    return made_once("ros2-nodes", state, partial(_build, place))


def _build(place: Place, prefix: Path) -> None:
    prefix.mkdir()
    done = place.run(["bash", "-c", _BUILD, str(SOURCES), str(prefix)], folders=[prefix])
    assert done.returncode == 0, f"{done.stdout[-3000:]}\n{done.stderr[-3000:]}"
