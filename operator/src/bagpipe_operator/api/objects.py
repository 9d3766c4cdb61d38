"""Objects as the API server sends them."""

from typing import Any

Json = dict[str, Any]


def is_older(version: str, known: str) -> bool:
    """Resource versions of one kind are comparable numbers in Kubernetes 1.34's storage."""
    if version.isdecimal() and known.isdecimal():
        return int(version) < int(known)
    return False
