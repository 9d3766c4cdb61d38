"""The criterion over what the stack used, as the agent measured it."""

import re
from typing import Any

from bagpipe.evaluate.evidence import Evidence
from bagpipe.evaluate.finding import Finding, NoEvidenceError
from bagpipe.evaluate.limits import bounded
from bagpipe.evaluate.model import Resources

_SUFFIXES = {
    "": 1, "k": 10**3, "M": 10**6, "G": 10**9, "T": 10**12,
    "Ki": 2**10, "Mi": 2**20, "Gi": 2**30, "Ti": 2**40,
}  # fmt: skip


def resources(name: str, wanted: Resources, evidence: Evidence) -> Finding:
    """CPU share or peak memory. Raises NoEvidenceError where the agent has measured nothing."""
    usage: dict[str, Any] = (evidence.result.get("stack") or {}).get("usage") or {}
    if wanted.max_cpu is not None:
        if not usage.get("seconds"):
            raise NoEvidenceError("the stack's CPU time was not measured in this case")
        figure = usage["cpu_seconds"] / usage["seconds"]
        found = bounded(
            Finding(name, "resources", "passed", figure, "CPUs", direction="lower"),
            None,
            wanted.max_cpu,
            f"used over {usage['seconds']:.1f} s",
        )
        if found.outcome == "failed" or wanted.max_memory is None:
            return found
    if not usage.get("peak_memory_bytes"):
        raise NoEvidenceError("the stack's memory was not measured in this case")
    return bounded(
        Finding(
            name, "resources", "passed", float(usage["peak_memory_bytes"]), "bytes",
            direction="lower",
        ),
        None,
        float(_bytes(wanted.max_memory or "0")),
        "at most at one time",
    )  # fmt: skip


def _bytes(quantity: str) -> int:
    found = re.fullmatch(r"([0-9]+(?:[.][0-9]+)?)([kMGT]i?|)", quantity)
    return int(float(found[1]) * _SUFFIXES[found[2]]) if found else 0
