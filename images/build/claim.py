"""Whose sources a folder of cargo's was built from: `python3 images/build/claim.py FOLDER`.

Cargo knows the crates of a workspace by their places in it, and what is fresh by times of files.
So of two checkouts that share such a folder one would get what the other has built later.
"""

from __future__ import annotations

import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
_OWNER = "checkout"


def last_built(target: Path) -> int:
    """When cargo last began to build a crate of ours there, in nanoseconds; 0 if it never did."""
    marks = target.glob("**/.fingerprint/bagpipe-*/invoked.timestamp")
    return max((mark.stat().st_mtime_ns for mark in marks), default=0)


def claim(target: Path, root: Path = ROOT) -> bool:
    """Has cargo build a checkout's own crates again if another has built into `target` since.

    Whether that is so. Who calls it keeps others from building there until cargo has ended. Sources
    that are younger than all that is built there stay as they are: to cargo they are new anyway,
    and what was built of them elsewhere would be built once more.
    """
    owner = target / _OWNER
    if owner.is_file() and owner.read_text() == str(root):
        return False
    agent = root / "images/agent"
    built = last_built(target)
    for source in [*agent.glob("crates/**/*.rs"), *agent.glob("crates/**/*.c")]:
        if source.stat().st_mtime_ns <= built:
            source.touch()
    target.mkdir(parents=True, exist_ok=True)
    owner.write_text(str(root))
    return True


if __name__ == "__main__":
    claim(Path(sys.argv[1]))
