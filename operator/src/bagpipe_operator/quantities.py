"""Kubernetes' quantities of memory, as far as pod sizes need them."""

import re

_UNITS = {
    "": 1, "k": 10**3, "M": 10**6, "G": 10**9, "T": 10**12, "P": 10**15,
    "Ki": 2**10, "Mi": 2**20, "Gi": 2**30, "Ti": 2**40, "Pi": 2**50,
}  # fmt: skip

_MEBIBYTE = 2**20
_LEAST_OVERHEAD_MIB = 384
_OVERHEAD_FACTOR = 0.4


def memory_bytes(quantity: str) -> int:
    """Bytes of a quantity such as 1Gi or 500M; raises ValueError for anything else."""
    match = re.fullmatch(r"([0-9]+(?:[.][0-9]+)?)([kMGTP]|[KMGTP]i)?", quantity)
    if match is None:
        raise ValueError(f"{quantity!r} is no quantity of memory: write for example 1Gi")
    return int(float(match[1]) * _UNITS[match[2] or ""])


def with_overhead(memory: str) -> str:
    """Memory of a container whose JVM gets `memory`: Spark's own rule for Python applications.

    40 percent on top, at least 384 MiB, for the Python processes beside the JVM.
    """
    heap = -(-memory_bytes(memory) // _MEBIBYTE)
    return f"{heap + max(_LEAST_OVERHEAD_MIB, round(heap * _OVERHEAD_FACTOR))}Mi"
