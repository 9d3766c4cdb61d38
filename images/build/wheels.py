"""Build what a laptop needs without a checkout: bagpipe, its native module, and the agent.

    .venv/bin/python images/build/wheels.py FOLDER

The wheels are for pip; the agent is one static program, for `bagpipe run --agent`. The same
sources give the same bytes.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

from context import ROOT, BuildError, memory_bag, package, stage_agent
from lock import LockError


def build(folder: Path) -> list[Path]:
    """Write the wheels and the agent into a folder; their paths. Raises BuildError."""
    folder.mkdir(parents=True, exist_ok=True)
    package(ROOT / "images" / "spark", folder)
    native = memory_bag(folder)
    stage_agent(folder)
    (bagpipe,) = folder.glob("bagpipe-[0-9]*.whl")
    return [bagpipe, native, folder / "bagpipe-agent"]


def main(arguments: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else "")
    parser.add_argument("folder", type=Path, help="where the wheels and the agent are written")
    try:
        for path in build(parser.parse_args(arguments).folder):
            print(f"{path}: {path.stat().st_size:,} bytes")
    except (BuildError, LockError) as error:
        print(f"Building the wheels failed. {error}", file=sys.stderr)
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
