"""`make bench BENCH=tail`: how long the last twentieth of a job's cases takes, by their order.

A job without earlier results runs its cases as they were planned; one with a baseline the longest
first. Both are run on the cluster (`make cluster install`), with as many slots for the same cases,
which only sleep; and simulated, each case given to the slot that is free first, over many orders.
"""

import base64
import heapq
import json
import os
import random
import statistics
import uuid
from collections.abc import Mapping, Sequence

from tests.bench.rows import Row
from tests.e2e import fleet, jobs
from tests.e2e import kubectl as k
from tests.e2e.conftest import EXAMPLE, driver_rights

CASES, SLOTS = 120, 8
RUNS = int(os.environ.get("BENCH_ROUNDS", "3"))
ORDERS = 2_000
# Most cases take about as long, a few much longer: a lognormal distribution (median 2 s).
_SIGMA, _MEDIAN = 0.8, 2.0
_GOAL = 0.5
_JOB_SECONDS = 600
_PROGRAM = """
import sys, time
from bagpipe import binpipe
for record in binpipe.read():
    seconds = float(record.read().decode())
    time.sleep(seconds)
    binpipe.write(b"done", name="digest")
"""


def durations() -> list[float]:
    """Seconds that each case sleeps, in the order in which cases are planned."""
    rng = random.Random("tail")  # noqa: S311  a distribution, and no secret
    return [_MEDIAN * rng.lognormvariate(0.0, _SIGMA) for _ in range(CASES)]


def tail(ends: Sequence[float]) -> float:
    """Seconds from when 95 % of the cases have ended to when all have."""
    ordered = sorted(ends)
    return ordered[-1] - ordered[len(ordered) * 95 // 100 - 1]


def simulated(seconds: Sequence[float], slots: int) -> list[float]:
    """When each case ends, if the next one always goes to the slot that is free first."""
    free = [0.0] * slots
    ends = []
    for each in seconds:
        ends.append(heapq.heappop(free) + each)
        heapq.heappush(free, ends[-1])
    return ends


def in_any_order(seconds: Sequence[float]) -> list[float]:
    """The tails of many random orders."""
    rng = random.Random("orders")  # noqa: S311  orders, and no secret
    orders = (rng.sample(list(seconds), len(seconds)) for _ in range(ORDERS))
    return [tail(simulated(order, SLOTS)) for order in orders]


def job(name: str, earlier: str = "") -> k.Object:
    """All cases on two executors, compared with an earlier job's results if there are any."""
    source, spark = {"files": ["pvc://recordings/tail/*.txt"]}, jobs.spark(2, SLOTS // 2)
    made = fleet.make_job(name, source=source, spark=spark)
    if earlier:
        made["spec"]["baseline"] = {"results": earlier}
    made["spec"]["stack"]["command"] = ["python3", "-c", _PROGRAM]
    return made


def put_files(namespace: str, seconds: Sequence[float]) -> None:
    """One input a case, all of as many bytes: nothing but earlier results says which is long."""
    program = (
        "import os; os.makedirs('/recordings/tail', exist_ok=True)\n"
        f"for n, s in enumerate({list(seconds)!r}):\n"
        "  open(f'/recordings/tail/{n:03d}.txt', 'w').write(f'{s:010.5f}')\n"
    )
    encoded = base64.b64encode(program.encode()).decode()
    run = f"import base64; exec(base64.b64decode('{encoded}'))"
    k.in_toolbox(namespace, "python3", "-c", run)


def ends_of(namespace: str, results: str) -> list[float]:
    """When each case's output was there, in seconds since 1970."""
    folder = "/" + results.removeprefix("pvc://") + "/cases"
    listed = k.in_toolbox(namespace, "find", folder, "-type", "f", "-printf", "%T@\\n")
    found = [float(line) for line in listed.splitlines()]
    assert len(found) == CASES, len(found)
    return found


def one_job(namespace: str, made: k.Object) -> tuple[float, str]:
    """The tail of a job, and where its results are."""
    jobs.apply(namespace, made)
    ended = jobs.ended(namespace, made["metadata"]["name"], _JOB_SECONDS)
    assert ended["status"].get("verdict") == "Passed", json.dumps(ended["status"])
    results = ended["status"]["results"]
    found = tail(ends_of(namespace, results))
    print(f"{made['metadata']['name']}: {found:.2f} s", flush=True)
    return found, results


def measure() -> tuple[Sequence[Row], Mapping[str, str], str]:
    """The tails of jobs of both kinds, one after the other, and simulated ones."""
    seconds = durations()
    name = f"bagpipe-bench-{uuid.uuid4().hex[:6]}"
    planned, longest = [], []
    k.create_namespace(name)
    try:
        k.kubectl("apply", "-f", "-", given=driver_rights(name))
        k.kubectl("-n", name, "apply", "-f", str(EXAMPLE / "volumes.yaml"))
        k.start_toolbox(name)
        put_files(name, seconds)
        for number in range(RUNS):
            as_planned, results = one_job(name, job(f"planned-{number}"))
            planned.append(as_planned)
            longest.append(one_job(name, job(f"longest-{number}", results))[0])
    finally:
        k.kubectl("delete", "namespace", name, "--wait=true", "--timeout=300s", seconds=320)
    first = [tail(simulated(sorted(seconds, reverse=True), SLOTS))]
    rows = [
        _row("on the cluster", longest, planned),
        _row("simulated", first, [tail(simulated(seconds, SLOTS))]),
        _row("simulated, any order", first, in_any_order(seconds)),
    ]
    note = (
        f"{CASES} cases that sleep, median {statistics.median(seconds):.1f} s, longest"
        f" {max(seconds):.1f} s, in {SLOTS} slots; the longest first beside the order of the plan;"
        f" {RUNS} jobs each, one after the other, and {ORDERS:,} random orders"
    )
    return rows, {}, note


def _row(case: str, longest: Sequence[float], others: Sequence[float]) -> Row:
    return Row(case, "from 95 % done to done", "s", longest, "as planned", others, 1 / _GOAL)
