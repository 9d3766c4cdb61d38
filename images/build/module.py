"""Build bagpipe.MemoryBag and install it into the virtual environment that runs this.

    .venv/bin/python images/build/module.py

It is the wheel that the Spark image gets. `uv sync` removes it, as it is not in uv.lock.
"""

from __future__ import annotations

import subprocess
import sys
import tempfile
from pathlib import Path

from context import memory_bag, tool
from failure import BuildError
from lock import LockError

INSTALL_SECONDS = 120.0


def install(wheel: Path) -> None:
    """Put a wheel in place of the one that is installed. Raises BuildError."""
    command = [tool("uv"), "pip", "install", "--quiet", "--python", sys.executable]
    command += ["--offline", "--no-deps", "--reinstall", str(wheel)]
    done = subprocess.run(
        command, capture_output=True, text=True, timeout=INSTALL_SECONDS, check=False
    )
    if done.returncode:
        raise BuildError(f"uv could not install {wheel.name}: {done.stderr.strip()}")


def main() -> int:
    try:
        with tempfile.TemporaryDirectory() as folder:
            install(memory_bag(Path(folder)))
    except (BuildError, LockError) as error:
        print(f"Building bagpipe.MemoryBag failed. {error}", file=sys.stderr)
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
