"""The cluster's programs are scripts, not an installed package: put them on the path."""

from __future__ import annotations

import sys
from pathlib import Path

CLUSTER = Path(__file__).resolve().parent
for folder in (CLUSTER, CLUSTER.parent.parent / "images/build"):
    sys.path.insert(0, str(folder))
