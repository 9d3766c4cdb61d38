"""Build what a laptop needs without a checkout: bagpipe, its native module, and the agent.

    .venv/bin/python images/build/wheels.py FOLDER

The first is a wheel with all three, for this kind of machine; behind it are bagpipe's and the
module's own. The same sources give the same bytes.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path

from context import ROOT, agent_binary, memory_bag, package
from cross import Target
from failure import BuildError
from lock import LockError
from whole_wheel import whole_wheel


def build_for(target: Target, folder: Path) -> Path:
    """Write the wheel with all three for another architecture; its path. Raises BuildError."""
    with tempfile.TemporaryDirectory() as scratch:
        package(ROOT / "images" / "spark", Path(scratch))
        native = memory_bag(Path(scratch), target)
        (bagpipe,) = Path(scratch).glob("bagpipe-[0-9]*-none-any.whl")
        folder.mkdir(parents=True, exist_ok=True)
        return whole_wheel(bagpipe, native, agent_binary(target), folder)


def build(folder: Path) -> list[Path]:
    """Write the wheels into a folder; their paths. Raises BuildError."""
    folder.mkdir(parents=True, exist_ok=True)
    package(ROOT / "images" / "spark", folder)
    native = memory_bag(folder)
    (bagpipe,) = folder.glob("bagpipe-[0-9]*-none-any.whl")
    return [whole_wheel(bagpipe, native, agent_binary(), folder), bagpipe, native]


def main(arguments: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else "")
    parser.add_argument("folder", type=Path, help="where the wheels are written")
    try:
        for path in build(parser.parse_args(arguments).folder):
            print(f"{path}: {path.stat().st_size:,} bytes")
    except (BuildError, LockError) as error:
        print(f"Building the wheels failed. {error}", file=sys.stderr)
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
