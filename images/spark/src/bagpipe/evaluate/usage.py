"""The criterion over what the stack used, as the agent measured it."""

from typing import Any

from bagpipe.evaluate.evidence import Evidence
from bagpipe.evaluate.finding import Finding, NoEvidenceError, covering
from bagpipe.evaluate.limits import bounded, of_all_bounds
from bagpipe.evaluate.model import Resources
from bagpipe.quantities import memory_bytes


def resources(name: str, wanted: Resources, evidence: Evidence) -> Finding:
    """CPU share or peak memory. Raises NoEvidenceError where the agent has measured nothing."""
    usage: dict[str, Any] = (evidence.result.get("stack") or {}).get("usage") or {}
    share, covered = _measured(usage, evidence)
    finding = _used(name, wanted, usage)
    return covering(
        finding,
        share,
        covered,
        "none",
        wanted.min_coverage,
        # A peak stays one; what is used in a part says nothing of the whole.
        lasting=finding.unit == "bytes",
        remedy="the stack ended early, or lower minCoverage",
    )


def _measured(usage: dict[str, Any], evidence: Evidence) -> tuple[float, str]:
    """How much of the play the stack was there for, in seconds of the clock on the wall."""
    timings: dict[str, Any] = evidence.result.get("timings") or {}
    there = float(usage.get("seconds") or 0.0)
    whole = evidence.seconds
    if "play" in timings:
        whole = float(timings["play"])
        there -= sum(float(timings.get(part) or 0.0) for part in ("subscribe", "lead_in"))
    share = 1.0 if whole <= 0 else min(1.0, max(0.0, there / whole))
    return share, f"{max(0.0, min(there, whole)):.1f} s of the {whole:.1f} s that were played"


def _used(name: str, wanted: Resources, usage: dict[str, Any]) -> Finding:
    found = []
    if wanted.max_cpu is not None:
        found.append(_cpu(name, wanted.max_cpu, usage))
    if wanted.max_memory is not None and (usage.get("peak_memory_bytes") or not _failed(found)):
        found.append(_memory(name, wanted.max_memory, usage))
    return of_all_bounds(found, found[-1])


def _failed(found: list[Finding]) -> bool:
    return any(each.outcome == "failed" for each in found)


def _cpu(name: str, most: float, usage: dict[str, Any]) -> Finding:
    if not usage.get("seconds"):
        raise NoEvidenceError("the stack's CPU time was not measured in this case")
    share = usage["cpu_seconds"] / usage["seconds"]
    finding = Finding(name, "resources", "passed", share, "CPUs", direction="lower")
    return bounded(finding, None, most, f"used over {usage['seconds']:.1f} s")


def _memory(name: str, most: str, usage: dict[str, Any]) -> Finding:
    if not usage.get("peak_memory_bytes"):
        raise NoEvidenceError("the stack's memory was not measured in this case")
    peak = float(usage["peak_memory_bytes"])
    finding = Finding(name, "resources", "passed", peak, "bytes", direction="lower")
    return bounded(finding, None, float(memory_bytes(most)), "at most at one time")
