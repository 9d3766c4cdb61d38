"""Jobs as large as the API server stores them: they wait, and the operator has its memory limit."""

import json
from pathlib import Path
from typing import Any

import yaml

from bagpipe.quantities import quantity
from tests.integration.control_plane.client import Client, Object, core, jobs
from tests.integration.control_plane.conftest import StartOperator
from tests.integration.control_plane.observe import UID_LABEL, a_job
from tests.integration.control_plane.operator_process import OperatorProcess
from tests.waiting import PATIENCE, wait_until

VALUES = Path(__file__).parents[4] / "charts/bagpipe/values.yaml"
# Each near the 1.5 MB that etcd takes. The API server computes for seconds on each (10,000 are a
# bench's).
JOBS, EDITED = 3, 1
# The API server takes seconds of a processor for each write too, and what ends before its answer
# begins at the front again: how long a write may last is no matter of this test.
PATIENT = {"BAGPIPE_REQUEST_SECONDS": "60", "BAGPIPE_LEASE_SECONDS": "600"}
# Three bytes of JSON for each, and sixty of Python's.
NOTHING: list[list[int]] = [[] for _ in range(470_000)]


def large(name: str, parameters: Object, **spec: Any) -> Object:
    job = a_job(name)
    job["spec"] |= spec
    job["spec"]["stack"]["parameters"] = parameters
    return job


def await_suspended(operator: OperatorProcess, count: int) -> None:
    suspended = 'bagpipe_jobs{phase="Suspended"}'
    wait_until(
        lambda: (operator.metric(suspended) or 0) >= count,
        PATIENCE,
        f"fewer than {count} are suspended",
    )


def peak(operator: OperatorProcess) -> int:
    """The most bytes that it has had in memory."""
    status = Path(f"/proc/{operator._process.pid}/status").read_text().splitlines()
    return next(int(line.split()[1]) * 1024 for line in status if line.startswith("VmHWM:"))


def test_jobs_of_a_megabyte_that_wait_fit_the_memory_limit_and_their_neighbour_runs(
    admin: Client, namespace: str, operator_process: StartOperator
) -> None:
    limit = yaml.safe_load(VALUES.read_text())["operator"]["resources"]["limits"]["memory"]
    waiting = large("waits", {"/x": NOTHING}, suspend=True)
    assert len(json.dumps(waiting, separators=(",", ":"))) > 1_400_000
    for number in range(JOBS):
        waiting["metadata"]["name"] = f"waits-{number:02d}"
        admin.create(jobs(namespace), waiting)
    operator = operator_process(**PATIENT)
    for count in range(1, JOBS + 1):
        await_suspended(operator, count)
    # What is large is asked for when its driver is made, and is whole.
    neighbour = large("runs", {f"/p{n}": [m % 7 for m in range(50)] for n in range(900)})
    admin.create(jobs(namespace), neighbour)
    configs = f"{core(namespace, 'configmaps')}?labelSelector={UID_LABEL}"
    wait_until(lambda: bool(admin.items(configs)), PATIENCE, "the neighbour was not begun")
    (config,) = admin.items(configs)
    parameters = json.loads(config["data"]["job.json"])["spec"]["stack"]["parameters"]
    assert parameters == neighbour["spec"]["stack"]["parameters"]
    # An edit goes through the watch, whole.
    events = 'bagpipe_watch_events_total{kind="SimulationJob"}'
    before = operator.metric(events) or 0
    for number in range(EDITED):
        admin.merge(jobs(namespace, f"waits-{number:02d}"), {"metadata": {"labels": {"a": "b"}}})
    wait_until(
        lambda: (operator.metric(events) or 0) >= before + EDITED, PATIENCE, "edits are lost"
    )
    print(f"{JOBS} waiting jobs: {peak(operator) >> 20} MiB at most")
    assert peak(operator) < 0.45 * quantity(limit)


def test_a_megabyte_of_wrong_values_is_refused_within_the_memory_of_any_other_job(
    admin: Client, namespace: str, operator_process: StartOperator
) -> None:
    """Each made several errors: 1.1 GB in twelve seconds, and no phase."""
    operator = operator_process(**PATIENT)
    admin.create(jobs(namespace), large("before", {}))
    await_phase(admin, namespace, "before", "Pending")
    before = peak(operator)
    hostile = large("wrong", {})
    hostile["spec"]["matrix"] = {"variables": {f"v{n}": [None] * 10_000 for n in range(13)}}
    more = large("many", {})
    more["spec"]["matrix"] = {"variables": {"v": NOTHING}}
    for job in (hostile, more):
        admin.create(jobs(namespace), job)
        await_phase(admin, namespace, job["metadata"]["name"], "Failed")
        found = admin.get(jobs(namespace, job["metadata"]["name"]))["status"]["conditions"]
        assert [c["reason"] for c in found if c["type"] == "Failed"] == ["SpecInvalid"]
    print(f"{(peak(operator) - before) >> 20} MiB for both")
    assert peak(operator) - before < 100 * 1024 * 1024


def await_phase(admin: Client, namespace: str, name: str, phase: str) -> None:
    wait_until(
        lambda: admin.get(jobs(namespace, name)).get("status", {}).get("phase") == phase,
        PATIENCE,
        f"{name} is not {phase}",
    )
