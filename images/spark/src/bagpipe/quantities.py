"""Kubernetes' quantities of memory and processors, as far as a spec has them; bytes for people.

`kubernetes.utils.parse_quantity` is not used: it takes `NaN`, `-1` and `1e99999`, which the CRD
refuses, and importing it loads the whole client.
"""

import re

# Of more digits a float makes infinity.
_LONGEST = 40
_QUANTITY = re.compile(r"([0-9]+(?:[.][0-9]+)?)([kMGT]|[KMGT]i|m)?")
_FACTOR = {
    "": 1.0, "m": 1e-3, "k": 1e3, "M": 1e6, "G": 1e9, "T": 1e12,
    "Ki": 2.0**10, "Mi": 2.0**20, "Gi": 2.0**30, "Ti": 2.0**40,
}  # fmt: skip
_MEBIBYTE = 2**20
_UNITS = ((1 << 40, "TiB"), (1 << 30, "GiB"), (1 << 20, "MiB"), (1 << 10, "KiB"))
_WHOLE = 100
# Spark refuses a JVM of less than 450 MiB, and the JVM counts a part of its heap as not usable.
_LEAST_HEAP_MEBIBYTES = 512


def quantity(text: str) -> float:
    """Bytes or cores of a quantity such as 500m, 2, 512Mi or 1Gi. Raises ValueError."""
    number = _number(text)
    if number is None:
        raise ValueError(f"{text!r} is not a quantity: write for example 500m, 2, 512Mi or 1Gi")
    return number


def memory_bytes(text: str) -> int:
    """Bytes of a quantity such as 1Gi or 500M. Raises ValueError."""
    number = None if text.endswith("m") else _number(text)
    if number is None:
        raise ValueError(f"{text!r} is no quantity of memory: write for example 1Gi")
    return int(number)


def size(count: float) -> str:
    """Bytes for people: 2.3 MiB."""
    for unit, name in _UNITS:
        if count >= unit:
            number = count / unit
            # Three digits, but never 1.02e+03.
            return f"{number:.0f} {name}" if number >= _WHOLE else f"{number:.3g} {name}"
    return f"{count:.0f} bytes"


def heap_mebibytes(memory: str) -> int:
    """The JVM's share in MiB of a Spark container's memory: half, at least 512."""
    return max(_LEAST_HEAP_MEBIBYTES, memory_bytes(memory) // _MEBIBYTE // 2)


def _number(text: str) -> float | None:
    match = _QUANTITY.fullmatch(text)
    if match is None or len(text) > _LONGEST:
        return None
    return float(match[1]) * _FACTOR[match[2] or ""]
