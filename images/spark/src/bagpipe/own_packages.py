"""The packages that Bagpipe was installed with, whatever PYTHONPATH puts before them.

A sourced ROS 2 sets it, and a workspace may have a NumPy or PyYAML of another release there, which
would be taken for ours. The stack keeps it as it is.
"""

import os
import sys
from pathlib import Path

# Our packages, and those to which others add engines and sources (`installed`).
_OURS = ("bagpipe", "bagpipe_operator", "bagpipe_engines", "bagpipe_sources")


def before_others() -> None:
    """Has this process look for modules in PYTHONPATH last, but where Bagpipe's own come from."""
    given = os.environ.get("PYTHONPATH", "").split(os.pathsep)
    others = [folder for folder in given if folder and not _is_ours(folder)]
    sys.path[:] = [p for p in sys.path if p not in others] + [p for p in sys.path if p in others]


def _is_ours(folder: str) -> bool:
    return any(Path(folder, name).is_dir() for name in _OURS)
