"""Where the start of a job goes: from `kubectl apply` to the first message, and case to case.

And of a job of a pool, which the driver of an earlier one takes.

It needs a cluster on this machine with the operator and the images, as `make cluster install`
leaves it: moments are of one clock. The node under test is a rospy node that publishes its own
moments; the recording is made here.
"""

import itertools
import json
import os
import threading
import time
import uuid
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path

from tests.bench import start_seen
from tests.bench.rows import Row
from tests.bench.start_seen import Moments
from tests.e2e import jobs
from tests.e2e import kubectl as k
from tests.e2e.conftest import EXAMPLE, driver_rights
from tests.e2e.nodes import IMAGE
from tests.recording import fetch

STARTS = int(os.environ.get("BENCH_ROUNDS", "10"))
NODE = Path(__file__).parent / "nodes/moments.py"
# In this order they are shown; what a job has not shown is left out.
ORDER = (
    "Accepted",
    "driver created",
    "driver scheduled",
    "driver's containers run",
    "planned",
    "Spark's JVM asked for",
    "executor created",
    "executor scheduled",
    "agent copied",
    "stack's container runs",
    "agent ready",
    "executor's containers run",
    "node's process",
    "node registered",
    "first message",
    "Complete",
)
FIRST_MESSAGE_GOAL = 8.0
WARM_GOAL = 0.3
POOL_GOAL = 2.0
_JOB_SECONDS = 300
_READ = """
import json, sys, rosbag
for path in sys.argv[1:]:
    with rosbag.Bag(path) as bag:
        print(json.dumps([json.loads(message.data) for _, message, _ in bag.read_messages()]))
"""

# What the node of a case published, and the seconds that it then took to end.
Case = tuple[list[dict[str, float]], float]
# Seconds from one case to the next, and the nodes' own part: one's end and the next one's start.
Change = tuple[float, float]


def job(name: str, pool: str = "") -> k.Object:
    """Four cases of four seconds, one after the other in one slot."""
    spark = jobs.spark(1, 1) | ({"pool": pool} if pool else {})
    made = jobs.make_job(name, source={"fragment": {"length": "4s"}}, spark=spark)
    made["spec"]["stack"] = {
        "image": IMAGE,
        "command": ["python3", "-c", NODE.read_text()],
    }
    step = {"trigger": "/joint_states", "answer": "/moments", "deadline": "60s"}
    made["spec"]["playback"]["steps"] = [step]
    made["spec"]["record"] = {"topics": ["/moments"]}
    return made


def cases_of(namespace: str, uri: str) -> list[Case]:
    """What the nodes published and took, in the order in which the cases ran."""
    folder = "/" + uri.removeprefix("pvc://")
    _, rows = k.results(namespace, uri)
    paths = [f"{folder}/{row['recorded']}" for row in rows]
    lines = k.in_toolbox(namespace, "python3", "-c", _READ, *paths).splitlines()
    stops = [row["result"]["timings"]["stop"] for row in rows]
    cases = zip(map(json.loads, lines), stops, strict=True)
    return sorted(cases, key=lambda case: case[0][0]["begun"])


def log_of(namespace: str, job: k.Object) -> str:
    """What a job's driver has logged since the job was created: in a pool it had others before."""
    status, since = job["status"], job["metadata"]["creationTimestamp"]
    if "pool" in job["spec"]["spark"]:
        assert status["pool"]["state"] == "Taken", status["pool"]
    pod = status["driver"]
    return k.kubectl("-n", namespace, "logs", pod, "--timestamps", f"--since-time={since}")


def one_start(namespace: str, name: str, pool: str = "") -> tuple[Moments, list[Case]]:
    """A job's moments, in seconds after it was applied, and what its nodes published.

    With a pool, a driver of it waits that takes the job: there are no pods of the job's own.
    """
    seen, over = Moments(), threading.Event()

    def take_job(found: k.Object, moment: float) -> None:
        if found["metadata"]["name"] == name:
            for what in start_seen.of_job(found):
                seen.note(what, moment)
            if found.get("status", {}).get("phase") in ("Complete", "Failed"):
                over.set()

    def take_pod(pod: k.Object, moment: float) -> None:
        if pod["metadata"]["name"].startswith(f"{name}-"):
            for what in start_seen.of_pod(pod):
                seen.note(what, moment)

    with (
        start_seen.watching(namespace, "simulationjobs", take_job),
        start_seen.watching(namespace, "pods", take_pod),
    ):
        applied = time.time()
        with jobs.applied(namespace, job(name, pool)):
            # Asking again and again would take what is measured from it.
            assert over.wait(_JOB_SECONDS), f"{name} does not end"
            ended = k.get(namespace, "simjob", name)
            assert ended["status"].get("verdict") == "Passed", jobs.account(namespace, ended)
            log = log_of(namespace, ended)
            cases = cases_of(namespace, ended["status"]["results"])
    for what, moment in start_seen.of_log(log):
        seen.note(what, moment)
    first = cases[0][0][0]
    seen.note("node's process", first["begun"])
    seen.note("node registered", first["registered"])
    seen.note("first message", first["received"])
    for what in seen:
        seen[what] -= applied
    return seen, cases


def case_to_case(cases: Sequence[Case]) -> Iterator[Change]:
    """Seconds from a case's last message to the next one's first, and what the nodes took of it."""
    for (before, stop), (after, _) in itertools.pairwise(cases):
        first = after[0]
        own = stop + first["registered"] - first["begun"]
        yield first["received"] - before[-1]["received"], own


def rows(
    starts: Sequence[Mapping[str, float]],
    in_pool: Sequence[Mapping[str, float]],
    changes: Sequence[tuple[float, float]],
) -> list[Row]:
    """The milestones of all starts, with pods of their own and without; then case to case."""
    found = []
    kinds = (("apply", starts, FIRST_MESSAGE_GOAL), ("apply, in a pool", in_pool, POOL_GOAL))
    for case, seen, first in kinds:
        for what in ORDER:
            if moments := [start[what] for start in seen if what in start]:
                goal = {"first message": first}.get(what)
                found.append(_row(case, what, moments, goal))
    found.append(_row("case to case", "of the nodes themselves", [own for _, own in changes], None))
    beyond = [whole - own for whole, own in changes]
    return [*found, _row("case to case", "beyond the nodes", beyond, WARM_GOAL)]


def _row(case: str, metric: str, ours: Sequence[float], goal: float | None) -> Row:
    known = goal is not None
    return Row(case, metric, "s", ours, "the goal" if known else "-", [goal] if goal else [],
               1.0 if known else None)  # fmt: skip


@contextmanager
def namespace_with_recording() -> Iterator[str]:
    """A namespace as users have it, removed at the end."""
    name = f"bagpipe-bench-{uuid.uuid4().hex[:6]}"
    k.create_namespace(name)
    try:
        k.kubectl("apply", "-f", "-", given=driver_rights(name))
        k.kubectl("-n", name, "apply", "-f", str(EXAMPLE / "volumes.yaml"))
        k.start_toolbox(name)
        k.put(name, fetch(), "pr2/joint_states.bag")
        yield name
    finally:
        k.kubectl("delete", "namespace", name, "--wait=true", "--timeout=300s", seconds=320)


def measure() -> tuple[Sequence[Row], Mapping[str, str], str]:
    """The medians of several starts, after one that is not counted."""
    starts: list[Moments] = []
    in_pool: list[Moments] = []
    changes: list[Change] = []
    with namespace_with_recording() as namespace:
        for number in range(STARTS + 1):
            seen, cases = one_start(namespace, f"start-{number}")
            _show(f"start {number}", seen)
            if number:
                starts.append(seen)
                changes += case_to_case(cases)
        with jobs.applied(namespace, job("first", "bench")) as first:
            jobs.ended(namespace, first, _JOB_SECONDS)
            for number in range(STARTS + 1):
                seen, _ = one_start(namespace, f"pooled-{number}", "bench")
                _show(f"start {number} in a pool", seen)
                if number:
                    in_pool.append(seen)
    return (
        rows(starts, in_pool, changes),
        {},
        f"{STARTS} starts of a job of four cases in one slot, and as many in a pool",
    )


def _show(which: str, seen: Moments) -> None:
    shown = [f"{what} {seen[what]:.2f}" for what in ORDER if what in seen]
    print(f"{which}: {', '.join(shown)}", flush=True)
