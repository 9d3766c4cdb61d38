"""Kubernetes' quantities of memory, as far as pod sizes need them."""

import re

_UNITS = {
    "": 1, "k": 10**3, "M": 10**6, "G": 10**9, "T": 10**12,
    "Ki": 2**10, "Mi": 2**20, "Gi": 2**30, "Ti": 2**40,
}  # fmt: skip

_MEBIBYTE = 2**20
# Of more digits a float makes infinity.
_LONGEST = 40
# Spark refuses a JVM of less than 450 MiB, and the JVM counts a part of its heap as not usable.
_LEAST_HEAP_MIB = 512


def memory_bytes(quantity: str) -> int:
    """Bytes of a quantity such as 1Gi or 500M; raises ValueError for anything else."""
    match = re.fullmatch(r"([0-9]+(?:[.][0-9]+)?)([kMGT]|[KMGT]i)?", quantity)
    if match is None or len(quantity) > _LONGEST:
        raise ValueError(f"{quantity!r} is no quantity of memory: write for example 1Gi")
    return int(float(match[1]) * _UNITS[match[2] or ""])


def heap(memory: str) -> str:
    """The JVM's share of a Spark container's memory, as the JVM writes it: half, at least 512m.

    The data plane splits an executor's memory the same way.
    """
    return f"{max(_LEAST_HEAP_MIB, memory_bytes(memory) // _MEBIBYTE // 2)}m"
