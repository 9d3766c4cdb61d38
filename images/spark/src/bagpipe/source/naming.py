"""How cases are called after their recordings."""

import posixpath
import re

_ENDINGS = (".bag", ".mcap")


def stem(uri: str) -> str:
    """A recording's name without its ending, of letters that a case's name may have.

    A folder of rosbag2, which its metadata.yaml stands for, has the folder's name.
    """
    name = posixpath.basename(uri.removesuffix("/metadata.yaml").rstrip("/"))
    ending = next((each for each in _ENDINGS if name.endswith(each)), "")
    return plain(name.removesuffix(ending), "bag")


def plain(name: str, otherwise: str) -> str:
    """A name of letters that a case's name may have; `otherwise` where nothing is left of it."""
    return re.sub(r"[^A-Za-z0-9_.-]+", "-", name).strip("-.") or otherwise
