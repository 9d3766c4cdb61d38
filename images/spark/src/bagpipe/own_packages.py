"""The packages that Bagpipe was installed with, whatever PYTHONPATH puts before them.

A sourced ROS 2 sets it, and a workspace may have a NumPy or PyYAML of another release there, which
would be taken for ours. The stack keeps it as it is.
"""

import os
import sys
from collections.abc import Mapping
from pathlib import Path


def before_others() -> None:
    """Has this process look for modules in PYTHONPATH last, but where Bagpipe itself comes from."""
    others = [folder for folder in _folders(os.environ) if not _has_bagpipe(folder)]
    sys.path[:] = [p for p in sys.path if p not in others] + [p for p in sys.path if p in others]


def own_environment_of(environment: Mapping[str, str]) -> dict[str, str]:
    """An environment for a program of ours: without what of PYTHONPATH is somebody else's."""
    own = {name: value for name, value in environment.items() if name != "PYTHONPATH"}
    kept = [folder for folder in _folders(environment) if _has_bagpipe(folder)]
    return own | ({"PYTHONPATH": os.pathsep.join(kept)} if kept else {})


def _folders(environment: Mapping[str, str]) -> list[str]:
    return [folder for folder in environment.get("PYTHONPATH", "").split(os.pathsep) if folder]


def _has_bagpipe(folder: str) -> bool:
    return any(Path(folder).glob("bagpipe*/__init__.py"))
