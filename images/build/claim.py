"""Whose sources a folder of cargo's was built from: `python3 images/build/claim.py FOLDER`.

Cargo knows the crates of a workspace by their places in it, and what is fresh by times of files.
So of two checkouts that share such a folder one would get what the other has built later.
"""

from __future__ import annotations

import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
_OWNER = "checkout"


def claim(target: Path, root: Path = ROOT) -> bool:
    """Has cargo build a checkout's own crates again if another has built into `target` since.

    Whether that is so. Who calls it keeps others from building there until cargo has ended.
    """
    owner = target / _OWNER
    if owner.is_file() and owner.read_text() == str(root):
        return False
    agent = root / "images/agent"
    for source in [*agent.glob("crates/**/*.rs"), *agent.glob("crates/**/*.c")]:
        source.touch()
    target.mkdir(parents=True, exist_ok=True)
    owner.write_text(str(root))
    return True


if __name__ == "__main__":
    claim(Path(sys.argv[1]))
