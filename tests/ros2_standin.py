"""The stand-in of ROS 2 (tests/ros2), built once for each state of its sources."""

import fcntl
import hashlib
import os
import shutil
import subprocess
from pathlib import Path

SOURCES = Path(__file__).parent / "ros2"
_BUILD_SECONDS = 300.0


def built() -> Path:
    """The folder that LD_LIBRARY_PATH names, as a sourced setup names the real one's."""
    digest = hashlib.sha256()
    for source in sorted(path for path in SOURCES.iterdir() if path.is_file()):
        digest.update(source.read_bytes())
    cache = Path(os.environ.get("BAGPIPE_CACHE", Path.home() / ".cache/bagpipe"))
    folder = cache / f"ros2-standin-{digest.hexdigest()[:16]}"
    cache.mkdir(parents=True, exist_ok=True)
    with (cache / "ros2-standin.lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        if not folder.exists():
            _build(folder)
    return folder


def _build(folder: Path) -> None:
    unfinished = folder.with_name(f"{folder.name}.unfinished")
    shutil.rmtree(unfinished, ignore_errors=True)
    command = ["make", "--silent", "-C", str(SOURCES), f"INTO={unfinished}"]
    environment = {name: value for name, value in os.environ.items() if name != "MAKEFLAGS"}
    done = subprocess.run(
        command,
        env=environment,
        capture_output=True,
        text=True,
        timeout=_BUILD_SECONDS,
        check=False,
    )
    assert done.returncode == 0, f"is Debian's cyclonedds-dev installed? {done.stderr}"
    unfinished.rename(folder)


def environment(folder: Path) -> dict[str, str]:
    """What a sourced setup would set."""
    return {"LD_LIBRARY_PATH": str(folder), "AMENT_PREFIX_PATH": str(SOURCES)}
