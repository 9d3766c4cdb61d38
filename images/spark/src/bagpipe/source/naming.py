"""How cases are called after their recordings."""

import posixpath
import re


def stem(uri: str) -> str:
    """A bag's name without its ending, of letters that a file's name may have."""
    base = posixpath.basename(uri).removesuffix(".bag")
    return re.sub(r"[^A-Za-z0-9_.-]+", "-", base).strip("-.") or "bag"
