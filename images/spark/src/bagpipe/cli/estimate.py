"""How long a planned job takes, and how much memory an executor's stack, before it runs. Pure."""

import heapq
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from bagpipe.counted import counted
from bagpipe.engine_fields import fields_of
from bagpipe.plan.case import Case
from bagpipe.plan.expected import Earlier, recorded_seconds
from bagpipe.quantities import heap_mebibytes, memory_bytes, size
from bagpipe.spec import SimulationJobSpec

# Around a play in real time: the start of the stack, its subscribers, its end, storage. Cases of
# one small node took 2 s; a stack that loads maps or networks takes longer than the most.
_LEAST_AROUND, _MOST_AROUND = 2.0, 20.0
# The agent beside a fragment, and the pipes (docs/operations/sizing.md).
_AGENT_BYTES, _SHARED_BYTES = 5 << 20, 64 << 20
# The driver's JVM beside its heap, its Python, and of each case a name and where it stands: with
# 1,000 executors and 100,000 cases (docs/scale.md, "Many executors").
_JVM_BYTES, _PYTHON_BYTES, _CASE_BYTES = 250 << 20, 95 << 20, 1536
# How far a run may lie from earlier ones of the same case, and from those of others.
_SAME, _OTHERS = (0.9, 1.25), (0.8, 1.5)
# Of the earlier figures for a case that has none of its own.
_LOW_SHARE, _HIGH_SHARE = 0.1, 0.9


@dataclass(frozen=True)
class Span:
    """Seconds, at least and at most; None where nothing bounds them."""

    low: float
    high: float | None


def estimate(spec: SimulationJobSpec, cases: Sequence[Case], earlier: Earlier) -> dict[str, Any]:
    """What a plan comes to; seconds are without the start of pods and the pulling of images.

    `withoutBasis` are cases of which only the least is known; `basis` counts the others by what
    they rest on.
    """
    slots = spec.spark.most_slots
    spans, basis = [], dict.fromkeys(("case", "fragment", "others", "recording"), 0)
    for case in cases:
        rests_on, span = _span(spec, case, earlier)
        basis[rests_on] += 1
        spans.append(span)
    highs = [span.high for span in spans if span.high is not None]
    lows = [span.low for span in spans]
    return {
        "cases": len(cases),
        "bytes": sum(case.bytes for case in cases),
        "slots": slots,
        "wallSeconds": [
            round(max(sum(lows) / slots, max(lows, default=0.0)), 1),
            round(_makespan(highs, slots), 1) if len(highs) == len(spans) else None,
        ],
        "basis": {name: count for name, count in basis.items() if count},
        "withoutBasis": len(spans) - len(highs),
        "memory": _memory(spec, cases, earlier),
    }


def _span(spec: SimulationJobSpec, case: Case, earlier: Earlier) -> tuple[str, Span]:
    if (own := earlier.own_seconds(case)) is not None:
        name, median = own
        return name, Span(_SAME[0] * median, _SAME[1] * median)
    recorded = recorded_seconds(case)
    if earlier.shares:
        shares = sorted(earlier.shares)
        low, high = (shares[round(s * (len(shares) - 1))] for s in (_LOW_SHARE, _HIGH_SHARE))
        return "others", Span(_OTHERS[0] * low * recorded, _OTHERS[1] * high * recorded)
    # A program that is given bytes takes as long as it likes.
    paced = fields_of(spec.stack.engine).encoding is not None
    if spec.playback.mode == "realtime" and paced:
        play = recorded / spec.playback.rate
        return "recording", Span(play + _LEAST_AROUND, play + _MOST_AROUND)
    return "recording", Span(_LEAST_AROUND, None)


def _makespan(durations: Sequence[float], slots: int) -> float:
    """When the last slot is free, where each takes the next case when it has done one."""
    free = [0.0] * min(slots, max(1, len(durations)))
    for seconds in durations:
        heapq.heapreplace(free, free[0] + seconds)
    return max(free)


def _memory(spec: SimulationJobSpec, cases: Sequence[Case], earlier: Earlier) -> dict[str, Any]:
    """Of one stack container, at the least: unpacked chunks come on top."""
    fragment = max((case.bytes for case in cases), default=0)
    slots = spec.spark.slots
    each = fragment + _AGENT_BYTES + (earlier.stack or 0) + (earlier.recorded or 0)
    limit = (spec.stack.resources.limits or {}).get("memory")
    return {
        "fragment": fragment,
        "stack": earlier.stack,
        "recorded": earlier.recorded,
        "executor": slots * each + _SHARED_BYTES,
        "limit": None if limit is None else memory_bytes(str(limit)),
        "driver": _driver(spec, len(cases)),
        "driverLimit": memory_bytes(spec.spark.driver.resources.memory),
    }


def _driver(spec: SimulationJobSpec, cases: int) -> int:
    """Bytes of the driver; its JVM fills its heap before it looks for room in it."""
    heap = heap_mebibytes(spec.spark.driver.resources.memory) << 20
    return heap + _JVM_BYTES + _PYTHON_BYTES + cases * _CASE_BYTES


def sentences(found: Mapping[str, Any], mode: str) -> list[str]:
    """The estimate for people."""
    low, high = found["wallSeconds"]
    time = f"{_time(low)} to {_time(high)}" if high is not None else f"at least {_time(low)}"
    slots = counted(found["slots"], "slot")
    read = f"{size(found['bytes'])} read"
    lines = [f"Estimate: {time} on {slots}, {read}; pods and images take their time beside."]
    words = {
        "case": f"{counted(found['basis'].get('case', 0), 'case')} by what the same case took",
        "fragment": "{} by what their fragment took",
        "others": "{} by what other cases took for each second of recording",
        "recording": "{} by the recording's length, and what is around each case is a guess",
    }
    parts = [words[name].format(count) for name, count in found["basis"].items()]
    lines.append(f"  It rests on: {', '.join(parts) or 'nothing: there is no case'}.")
    if found["withoutBasis"]:
        lines.append(
            f"  How long {counted(found['withoutBasis'], 'case')} may take in playback.mode: {mode}"
            " is the stack's affair: earlier results say it (--results)."
        )
    return [*lines, *_of_memory(found["memory"]), *_of_driver(found["memory"], found["cases"])]


def _of_driver(found: Mapping[str, Any], cases: int) -> list[str]:
    """A warning; of a driver that has room nothing."""
    if found["driver"] <= found["driverLimit"]:
        return []
    needs, limit = size(found["driver"]), size(found["driverLimit"])
    text = f"  Memory of the driver: {needs} with {cases:,} cases, ABOVE its limit {limit}"
    return [f"{text}: raise spark.driver.resources.memory."]


def _of_memory(found: Mapping[str, Any]) -> list[str]:
    parts = [f"the largest fragment {size(found['fragment'])}"]
    for key, words in (("stack", "the stack"), ("recorded", "its recording")):
        if found[key] is not None:
            parts.append(f"{words} {size(found[key])} as it was measured")
    missing = "" if found["stack"] is not None else "; what the stack itself takes is not known"
    text = (
        f"  Memory of an executor's stack: at least {size(found['executor'])}"
        f" ({', '.join(parts)}; compressed chunks unpacked come on top{missing})"
    )
    limit = found["limit"]
    if limit is None:
        return [f"{text}, without a limit (stack.resources.limits)."]
    if found["executor"] > limit:
        return [f"{text}, ABOVE its limit {size(limit)}: raise that, or cut shorter fragments."]
    return [f"{text}, of its limit {size(limit)}."]


def _time(seconds: float) -> str:
    if seconds < 90:
        return f"{seconds:.0f} s"
    return f"{seconds / 60:.0f} min" if seconds < 5400 else f"{seconds / 3600:.1f} h"
