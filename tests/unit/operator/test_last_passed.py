"""A job that is compared with the last good run of a schedule: which one, and from when on."""

import json
from typing import Any

import pytest

from bagpipe.spec import JobFile
from bagpipe_operator.api import names
from bagpipe_operator.api.objects import Json
from bagpipe_operator.cluster.client import ApiError
from bagpipe_operator.jobs.job_view import JobView
from bagpipe_operator.jobs.policies.last_passed import last_passed
from tests.unit.operator.builders import JobBuilder, make_driver, make_job
from tests.unit.operator.world import World

SCHEDULE_UID = "uid-of-nightly"
# Minutes since 1970: 2026-11-17, 18, 19 and 20, each at 02:30 in UTC.
RUNS = [29914710 + 1440 * day for day in range(4)]


def schedule(**status: Any) -> Json:
    metadata = {"name": "nightly", "namespace": "lanes", "uid": SCHEDULE_UID}
    return {"metadata": metadata, "spec": {}, "status": status}


def run(at: int, passed: str = "True", owner: str = SCHEDULE_UID, **status: Any) -> Json:
    """The job of a run; `passed` is the status of its condition Passed."""
    name = f"nightly-{at}"
    made = make_job(name).object
    made["metadata"] |= {
        "labels": {names.LABEL_SCHEDULE: "nightly"},
        "ownerReferences": [names.owner_reference("nightly", owner, names.SCHEDULE_KIND)],
    }
    conditions = [
        {"type": "Complete", "status": "True"},
        {"type": "Passed", "status": passed},
    ]
    made["status"] = {"conditions": conditions, "results": f"pvc://results/lane/{name}/u"} | status
    return made


def follower(name: str = "x") -> JobBuilder:
    return make_job(name).with_spec("baseline", {"lastPassed": "schedule/nightly"})


def world_of(*jobs: Json, job: JobBuilder | None = None, **status: Any) -> World:
    world = World(job or follower())
    world.api.put("schedules", schedule(**status))
    for each in jobs:
        world.api.put("jobs", each)
    return world


def job_file(world: World, stem: str = "x-1") -> JobFile:
    return JobFile.model_validate_json(world.config(stem)["data"]["job.json"])


def kept(at: int) -> Json:
    return {
        "job": f"nightly-{at}", "results": f"pvc://results/lane/nightly-{at}/kept",
        "scheduleTime": "2026-11-19T02:30:00Z",
    }  # fmt: skip


async def test_the_latest_run_that_passed_is_written_before_there_is_a_driver() -> None:
    world = world_of(run(RUNS[0]), run(RUNS[1]), run(RUNS[2], "False"), run(RUNS[3], "Unknown"))
    await world.reconcile()
    assert world.api.named("pods") == []
    assert world.status()["baseline"] == {
        "schedule": "nightly", "job": f"nightly-{RUNS[1]}", "scheduleTime": "2026-11-18T02:30:00Z",
        "results": f"pvc://results/lane/nightly-{RUNS[1]}/u",
    }  # fmt: skip
    await world.reconcile()
    written = job_file(world)
    assert written.spec.compared_with == f"pvc://results/lane/nightly-{RUNS[1]}/u"
    assert written.baseline is not None
    assert (written.baseline.schedule, written.baseline.job) == ("nightly", f"nightly-{RUNS[1]}")
    assert world.reason("BaselineFound") == "True/LastPassed"
    assert f"compared with nightly-{RUNS[1]}, the last job" in world.message("BaselineFound")
    assert world.api.event_reasons().count("LastPassed") == 1


async def test_what_was_found_stays_whatever_passes_and_goes_meanwhile() -> None:
    world = world_of(run(RUNS[0]))
    await world.reconcile()
    before = world.status()["baseline"]
    world.api.put("jobs", run(RUNS[1]))
    del world.api.objects["jobs", f"nightly-{RUNS[0]}"]
    del world.api.objects["schedules", "nightly"]
    await world.reconcile()
    world.deliver(make_driver("x").ended(137))
    await world.reconcile()
    await world.reconcile(after=11)
    assert world.api.named("pods")[-1] == "x-2-driver"
    first, second = job_file(world, "x-1"), job_file(world, "x-2")
    assert first.spec.compared_with == second.spec.compared_with == before["results"]
    assert world.status()["baseline"] == before


def test_a_run_is_compared_with_one_before_it_and_never_with_itself() -> None:
    third = run(RUNS[2])
    listed = [run(RUNS[0]), run(RUNS[1]), third, run(RUNS[3])]
    found = last_passed(JobView.from_object(third), schedule(), listed)
    assert found is not None
    assert found.job == f"nightly-{RUNS[1]}"
    first = last_passed(JobView.from_object(listed[0]), schedule(), listed)
    assert first is None
    # One that only has a run's name is compared with the latest of all.
    namesake = run(RUNS[1], owner="uid-of-another")
    others = [listed[0], third, listed[3], namesake]
    found = last_passed(JobView.from_object(namesake), schedule(), others)
    assert found is not None
    assert found.job == f"nightly-{RUNS[3]}"


async def test_a_run_whose_job_is_gone_is_known_from_the_schedule() -> None:
    world = world_of(run(RUNS[0]), run(RUNS[3], "False"), lastPassed=kept(RUNS[2]))
    await world.reconcile()
    assert world.status()["baseline"] == {"schedule": "nightly"} | kept(RUNS[2])


async def test_the_first_night_has_no_baseline_and_says_so() -> None:
    job = follower().with_spec("variants", [{"name": "a"}, {"name": "b"}])
    world = world_of(run(RUNS[0], "False"), job=job)
    await world.reconcile()
    assert world.status()["baseline"] == {"schedule": "nightly"}
    assert world.reason("BaselineFound") == "False/NoBaselineYet"
    assert world.message("BaselineFound").startswith(
        "Nothing is compared: no earlier job of the schedule nightly has passed yet"
    )
    world.api.put("jobs", run(RUNS[1]))
    await world.reconcile()
    written = job_file(world)
    assert written.spec.baseline is None
    assert written.baseline is not None
    assert written.baseline.job == ""
    assert "no earlier job of the schedule nightly has passed yet" in written.baseline.message
    assert world.api.event_reasons().count("NoBaselineYet") == 1


async def test_what_is_not_the_schedule_s_is_no_baseline() -> None:
    stranger = run(RUNS[1], owner="uid-of-another")
    unnamed = run(RUNS[2])
    unnamed["metadata"]["name"] = "nightly-copy"
    world = world_of(stranger, unnamed, run(RUNS[3], results=""))
    await world.reconcile()
    assert world.status()["baseline"] == {"schedule": "nightly"}


async def test_a_schedule_that_is_not_there_is_refused() -> None:
    world = World(follower())
    await world.reconcile()
    assert world.reason("Failed") == "True/BaselineRefused"
    assert world.message("Failed") == (
        "There is no SimulationSchedule nightly in namespace lanes, which spec.baseline.lastPassed"
        " names: correct the name, or create the schedule first."
    )
    assert world.api.named("pods") == []


async def test_a_fault_of_the_api_server_is_tried_again() -> None:
    world = world_of(run(RUNS[0]))
    world.api.fail("list jobs", ApiError(0, "Unreachable", "no answer"))
    with pytest.raises(ApiError):
        await world.reconcile()
    assert "baseline" not in world.status()
    await world.reconcile()
    assert world.status()["baseline"]["job"] == f"nightly-{RUNS[0]}"


@pytest.mark.parametrize(
    "forged",
    [
        {"schedule": "other", "job": "a", "results": "pvc://secret/x"},
        {"schedule": "nightly", "job": "a"},
        {"schedule": "nightly", "results": "pvc://secret/x"},
    ],
)
async def test_what_the_operator_did_not_write_is_looked_for_again(forged: Json) -> None:
    world = world_of(run(RUNS[0]), job=follower().with_status(baseline=forged))
    await world.reconcile()
    assert world.status()["baseline"]["results"] == f"pvc://results/lane/nightly-{RUNS[0]}/u"


async def test_results_that_no_job_may_name_are_refused() -> None:
    world = world_of(run(RUNS[0], results="http://u:p@host/x"))
    await world.reconcile()
    await world.reconcile()
    assert world.reason("Failed") == "True/SpecInvalid"
    assert "spec.baseline.results" in world.message("Failed")


async def test_the_claim_of_the_results_is_mounted_read_only() -> None:
    world = world_of(run(RUNS[0], results="pvc://archive/lane/u"))
    await world.reconcile()
    await world.reconcile()
    [driver] = world.api.objects["pods", "x-1-driver"]["spec"]["containers"]
    mounts = {m["mountPath"].rpartition("/")[2]: m["readOnly"] for m in driver["volumeMounts"]
              if m["name"].startswith("claim-")}  # fmt: skip
    assert mounts == {"recordings": True, "results": False, "archive": True}


async def test_a_job_too_large_to_keep_follows_its_schedule_too() -> None:
    job = follower().with_spec("stack.parameters", {"/x": "y" * 50_000})
    world = world_of(run(RUNS[0]), job=job)
    await world.reconcile()
    await world.reconcile()
    assert json.loads(world.config("x-1")["data"]["job.json"])["spec"]["baseline"] == {
        "results": f"pvc://results/lane/nightly-{RUNS[0]}/u"
    }
