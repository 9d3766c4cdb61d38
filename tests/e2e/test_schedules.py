"""A schedule on the cluster: its minute comes, its job runs to its end; then it is suspended."""

from collections.abc import Iterator
from pathlib import Path

import pytest
import yaml

from tests.e2e import jobs
from tests.e2e import kubectl as k

pytestmark = [pytest.mark.e2e, pytest.mark.slow]

EXAMPLES = Path(__file__).parents[2] / "docs/examples"
NAME = "highway-nightly"


@pytest.fixture
def schedule(namespace: str) -> Iterator[str]:
    """The example's manifest, each minute instead of each night; two scenarios on the claim."""
    for scenario in sorted((EXAMPLES / "exec-highway/scenarios").glob("*.json"))[:2]:
        k.put(namespace, scenario, f"scenarios/{scenario.name}")
    manifest = yaml.safe_load((EXAMPLES / "schedule/schedule.yaml").read_text())
    manifest["spec"]["schedule"] = "* * * * *"
    jobs.apply(namespace, manifest)
    yield NAME
    what = ("simschedule", NAME, "--ignore-not-found", "--wait=true", "--timeout=60s")
    k.kubectl("-n", namespace, "delete", *what)


def test_a_minute_s_job_runs_to_its_end(namespace: str, schedule: str) -> None:
    k.kubectl("-n", namespace, "wait", "--for=condition=Ready", f"simschedule/{schedule}")
    selector = ("simjob", "-l", f"sim.bagpipe.io/schedule={NAME}")
    k.await_that("the minute's job", lambda: k.items(namespace, *selector), 75)
    suspend = '{"spec":{"suspend":true}}'
    k.kubectl("-n", namespace, "patch", "simschedule", NAME, "--type=merge", "-p", suspend)
    (job,) = k.items(namespace, *selector)
    name = job["metadata"]["name"]
    minutes = int(name.removeprefix(f"{NAME}-"))

    def active() -> list[str]:
        found: list[str] = k.get(namespace, "simschedule", NAME)["status"].get("active", [])
        return found

    # The status is written after the job.
    assert k.await_that("the schedule to name its job", active, 30) == [name]
    assert jobs.ended(namespace, name, 240)["status"]["phase"] == "Complete"

    def ended() -> k.Object | None:
        found: k.Object = k.get(namespace, "simschedule", NAME)["status"]
        return found if found["active"] == [] else None

    status = k.await_that("the schedule to report the end", ended, 60)
    assert status["lastSuccessfulTime"] > status["lastScheduleTime"]
    assert "nextScheduleTime" not in status

    def reasons() -> list[str]:
        which = f"--field-selector=involvedObject.name={NAME}"
        return sorted(event["reason"] for event in k.items(namespace, "events", which))

    # Events come after the status that they report.
    k.await_that("both Events", lambda: len(reasons()) >= 2, 60)
    assert reasons() == ["JobStarted", "SuspendedBySpec"]
    assert minutes > 29_000_000
    assert len(k.items(namespace, *selector)) == 1
