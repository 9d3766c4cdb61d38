"""How cases are called after their recordings."""

import posixpath
import re


def stem(uri: str) -> str:
    """A recording's name without its ending, of letters that a case's name may have."""
    return plain(posixpath.basename(uri).removesuffix(".bag").removesuffix(".mcap"), "bag")


def plain(name: str, otherwise: str) -> str:
    """A name of letters that a case's name may have; `otherwise` where nothing is left of it."""
    return re.sub(r"[^A-Za-z0-9_.-]+", "-", name).strip("-.") or otherwise
