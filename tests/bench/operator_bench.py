"""The operator on a real API server with KWOK's nodes, beside kubeflow/spark-operator.

Called by `make bench BENCH=operator`; a module named operator would hide Python's own.
"""

import asyncio
import logging
import os
import platform
import sys
from collections.abc import Awaitable, Callable, Coroutine, Iterator
from importlib.metadata import version
from typing import Any, TypeVar

from embedded import builds
from embedded.failure import ClusterError

from tests.bench import operator_load as load
from tests.bench import operator_peer as peer
from tests.bench.operator_largest import LARGEST, largest
from tests.bench.operator_load import p50, p99
from tests.bench.operator_world import PROCESSOR
from tests.bench.rows import Load, Row

logger = logging.getLogger(__name__)
Result = TypeVar("Result")

ROUNDS = 3
# What counts may wait for (BAGPIPE_PROGRESS_WAIT_SECONDS), and two visits.
PROGRESS_WAIT = 34.0
# One round of the peer takes more than a minute and depends little on chance.
PEER_ROUNDS = 1
KWOK_VERSION = "v0.8.0"
PEER = f"kubeflow/spark-operator {peer.VERSION}"
NOTE = (
    "Real: etcd, API server, controllers and scheduler (1.34), and the operator as a process on "
    f"processor {PROCESSOR} alone; everything else, the bench's own client among it, runs on all "
    "processors, that one too. Fake: KWOK plays the nodes and calls every pod running at once; a "
    "small server answers for all drivers, whose count of passed cases grows every second. No "
    "executor is ever created by these drivers. A job is the example's, with 8 KB of parameters. "
    "The peer calls the spark-submit of pyspark, a JVM for each application; its webhook is off. "
    "Each load has a cluster of its own. From apply: from the POST of the first job to the last "
    "driver pod that a watch showed. Latency: from the answer to a job's POST. Age of counts: for "
    "how long they have been out of date, sampled four times a second over all running jobs."
)


def about() -> tuple[dict[str, str], str]:
    """The versions of what is compared, and what one must know to read the rows."""
    versions = {
        "kubernetes": builds.KUBERNETES,
        "kwok": KWOK_VERSION,
        "spark-operator": peer.VERSION,
        "pyspark": version("pyspark"),
        "kopf": version("kopf"),
        "python": platform.python_version(),
    }
    return versions, NOTE


def loads() -> Iterator[Load]:
    """The loads that BENCH_LOADS names, or all; each as soon as it has ended, well or not."""
    for name in chosen(os.environ.get("BENCH_LOADS", "")):
        try:
            rows = asyncio.run(LOADS[name](scale(), int(os.environ.get("BENCH_ROUNDS", ROUNDS))))
        except Exception as error:
            # Whatever one load died of, the hours of the others must not be lost with it.
            logger.exception("the load %s", name)
            yield Load(name, failure=f"{type(error).__name__}: {error}")
        else:
            yield Load(name, rows)


def chosen(text: str) -> list[str]:
    """The loads of a comma-separated list, all for an empty one; exits with those there are."""
    names = [name.strip() for name in text.split(",") if name.strip()]
    unknown = [name for name in names if name not in LOADS]
    if unknown:
        sys.exit(f"BENCH_LOADS names {', '.join(unknown)}; there are: {','.join(LOADS)}")
    return names or list(LOADS)


def scale() -> float:
    """What part of the full size is run."""
    return float(os.environ.get("BENCH_SCALE", "1"))


def kept() -> bool:
    """Whether the rows are those that are promised; a smaller size only tries the loads."""
    return scale() == 1.0


def scaled(count: int, scale: float) -> int:
    return max(1, round(count * scale))


async def _announced(what: str, load_of: Awaitable[Result]) -> Result:
    print(f"    {what}", file=sys.stderr, flush=True)
    return await load_of


async def _beside_the_peer(scale: float, rounds: int) -> list[Row]:
    count = scaled(load.ALONE, scale)
    ours = [
        (await _announced(f"{count} jobs at once", load.creation_rate(count)))[1]
        for _ in range(rounds)
    ]
    theirs = []
    for _ in range(min(rounds, PEER_ROUNDS)):
        try:
            took = await _announced(f"{count} applications at once", peer.seconds_to_pods(count))
        except (TimeoutError, ClusterError) as error:
            print(f"    left out: {PEER}: {error}", file=sys.stderr, flush=True)
            break
        theirs.append(took[1])
    return [Row(f"{count} at once", "to the last driver pod", "s", ours, PEER, theirs)]


async def _rate(scale: float, rounds: int) -> list[Row]:
    count = scaled(load.RATED, scale)
    rates = [
        (await _announced(f"{count} jobs at once", load.creation_rate(count)))[0]
        for _ in range(rounds)
    ]
    return [Row(f"{count} at once", "driver pods", "jobs/s", rates, "the promise", [10.0], 1.0)]


async def _steady(scale: float, _rounds: int) -> list[Row]:
    seconds = load.STEADY_SECONDS * scale
    found = await _announced(
        f"{load.PER_SECOND:g} jobs/s for {seconds:g} s", load.steady(load.PER_SECOND, seconds)
    )
    case = f"{load.PER_SECOND:g} jobs/s"
    return [
        promised(case, "creation to driver pod, p99", "s", p99(found.to_pod), 2.0),
        promised(case, "creation to Accepted, p99", "s", p99(found.to_accepted), 2.0),
        Row(case, "operator's processor", "%", [100 * found.processor], "", []),
    ]


async def _burst(scale: float, _rounds: int) -> list[Row]:
    count = scaled(load.BURST, scale)
    found = await _announced(f"{count} jobs at once, which then run", load.burst(count))
    case = f"burst of {count:,}"
    return [
        *_of_kind(case, "driver's pod to Accepted", found.accepted, 5.0),
        *_of_kind(case, "driver runs to status says so", found.late, 5.0),
        *_of_kind(case, "first fault to status says so", found.faults, 5.0),
        *_of_kind(case, "age of counts", found.stale, PROGRESS_WAIT),
        promised(case, "driver pods", "jobs/s", found.rate, 10.0),
    ]


def _of_kind(case: str, what: str, seconds: list[float], promise: float) -> list[Row]:
    return [
        Row(case, f"{what}, p50", "s", [p50(seconds)], "", []),
        promised(case, f"{what}, p99", "s", p99(seconds), promise),
    ]


async def _full(scale: float, _rounds: int) -> list[Row]:
    finished, running = scaled(load.FINISHED, scale), scaled(load.RUNNING, scale)
    pods = running * load.PODS_PER_JOB
    case = f"{finished:,} finished, {running:,} running, {pods:,} pods"
    found = await _announced(case, load.full(finished, running, load.PODS_PER_JOB))
    return [
        promised(case, "cold start", "s", found.start, 15.0),
        Row(case, "operator's processor in the start", "s", [found.processor], "", []),
        promised(case, "memory at most", "MiB", found.peak, 512.0),
        promised(case, "/metrics, p99", "ms", 1e3 * p99(found.metrics), 100.0),
        Row(case, "/metrics during the start, p99", "ms", [1e3 * p99(found.metrics_at_start)],
            "", []),
    ]  # fmt: skip


async def _cycles(scale: float, _rounds: int) -> list[Row]:
    count = scaled(load.CYCLES, scale)
    found = await _announced(f"{count} jobs created and deleted, under kills", load.cycles(count))
    case = f"{count:,} created and deleted"
    return [
        promised(case, "left", "objects", found.left, 0.0),
        Row(case, "the operator was killed", "times", [found.kills], "", []),
    ]


async def _largest(scale: float, _rounds: int) -> list[Row]:
    count = scaled(LARGEST, scale)
    found = await _announced(f"{count:,} jobs of the largest size", largest(count))
    case = f"{count:,} suspended jobs of {found.job_bytes:,} bytes"
    return [
        promised(case, "memory at most", "MiB", found.peak_mib, 512.0),
        Row(case, "until each was looked at", "s", [found.seconds], "", []),
        Row(case, "operator's processor until then", "s", [found.processor_seconds], "", []),
    ]


LOADS: dict[str, Callable[[float, int], Coroutine[Any, Any, list[Row]]]] = {
    "peer": _beside_the_peer,
    "rate": _rate,
    "steady": _steady,
    "burst": _burst,
    "full": _full,
    "cycles": _cycles,
    "largest": _largest,
}


def promised(case: str, metric: str, unit: str, value: float, promise: float) -> Row:
    """A row beside a promise, which is to be met in full."""
    return Row(case, metric, unit, [value], "the promise", [promise], 1.0)
