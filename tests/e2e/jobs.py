"""SimulationJobs for the end-to-end tests: the example's job, small, with the given changes."""

import json
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import yaml

from tests import waiting
from tests.e2e import kubectl as k

EXAMPLE = Path(__file__).parents[2] / "docs/examples/robot-state-publisher/job.yaml"


def spark(executors: int, slots: int) -> k.Object:
    """A new section, of a driver and executors for which any node has room."""
    driver, executor = ({"resources": {"cpu": "100m", "memory": "1Gi"}} for _ in range(2))
    return {"executors": executors, "slots": slots, "driver": driver, "executor": executor}


def example() -> k.Object:
    """The example's manifest as it is."""
    loaded: k.Object = yaml.safe_load(EXAMPLE.read_text())
    return loaded


def make_job(name: str, **changed: dict[str, Any]) -> k.Object:
    """The example's job on one executor, one fragment per bag, with spec sections updated.

    It stays in lock-step, where no machine is too slow for a node with a queue of one; another
    `mode` replaces the whole playback.
    """
    job = patient(example())
    job["metadata"]["name"] = name
    spec = job["spec"]
    spec["source"]["fragment"] = {"length": "60s"}
    spec["spark"] = spark(1, 1)
    if "mode" in changed.get("playback", {}):
        spec["playback"] = {"subscribeTimeout": "60s"}
    for section, fields in changed.items():
        spec[section] = spec[section] | fields
    return job


def patient(job: k.Object) -> k.Object:
    """The job, for which a machine that stands still for seconds is no stack without answers."""
    waiting.patient(job["spec"])
    return job


def apply(namespace: str, job: k.Object) -> None:
    """kubectl apply a job."""
    k.kubectl("-n", namespace, "apply", "-f", "-", given=json.dumps(job))


@contextmanager
def applied(namespace: str, job: k.Object) -> Iterator[str]:
    """A job's name while it exists; it is deleted however the block ends."""
    apply(namespace, job)
    name: str = job["metadata"]["name"]
    try:
        yield name
    finally:
        delete(namespace, name)


def ended(namespace: str, name: str, seconds: float) -> k.Object:
    """The job once it is Complete or Failed."""

    def look() -> k.Object | None:
        job = k.get(namespace, "simjob", name)
        return job if job.get("status", {}).get("phase") in ("Complete", "Failed") else None

    return k.await_that(f"{name} to end", look, seconds)


def account(namespace: str, job: k.Object) -> str:
    """What a job and its cases say of how they ended, for the message of a test that fails."""
    status = job["status"]
    lines = [json.dumps({key: status.get(key) for key in ("conditions", "cases", "ledger")})]
    if "results" in status:
        try:
            rows = k.results(namespace, status["results"])[1]
        except k.KubectlError as error:
            rows, lines = [], [*lines, f"and no results can be read: {error}"]
        lines += [json.dumps(row) for row in rows if row["outcome"] != "passed"]
    return "\n".join(lines)


def condition(job: k.Object, kind: str) -> k.Object:
    """A condition of a job by its type. Raises KeyError."""
    conditions: dict[str, k.Object] = {each["type"]: each for each in job["status"]["conditions"]}
    return conditions[kind]


def delete(namespace: str, name: str) -> None:
    """kubectl delete a job and wait until it is gone."""
    what = ("simjob", name, "--ignore-not-found", "--wait=true", "--timeout=300s")
    k.kubectl("-n", namespace, "delete", *what, seconds=320)


def await_none_left(namespace: str) -> None:
    """Wait until a namespace has no job and nothing of one. The failure names what is left."""
    left: list[str] = []

    def look() -> bool:
        left[:] = left_in(namespace)
        return not left

    waiting.wait_until(look, 240, lambda: "these are left: " + "; ".join(left), 0.5)


def left_in(namespace: str) -> list[str]:
    """Every pod, ConfigMap and job of a namespace but the tests' own toolbox and the cluster's,
    with since when it is being deleted, for how long it may, and which of its containers run."""
    found = k.items(namespace, "simulationjobs,pods,configmaps")
    own = {("Pod", k.TOOLBOX), ("ConfigMap", "kube-root-ca.crt")}
    left = [each for each in found if (each["kind"], each["metadata"]["name"]) not in own]
    return [_described(each) for each in left]


def _described(each: k.Object) -> str:
    meta, status = each["metadata"], each.get("status", {})
    containers = [
        f"{one['name']} {next(iter(one['state']), 'unknown')}"
        for kind in ("initContainerStatuses", "containerStatuses")
        for one in status.get(kind, [])
    ]
    return (
        f"{each['kind']}/{meta['name']} (to be gone by {meta.get('deletionTimestamp', 'never')}, "
        f"grace period {meta.get('deletionGracePeriodSeconds', 'none')}, "
        f"{', '.join(containers) or 'no containers'})"
    )
