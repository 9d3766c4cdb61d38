"""How often the API server is asked for what it has refused, and what is reported meanwhile."""

from collections import Counter
from dataclasses import replace

import pytest

from bagpipe_operator.cluster.client import ApiError
from tests.unit.operator.builders import make_job
from tests.unit.operator.test_reconcile import MISSING_ACCOUNT
from tests.unit.operator.world import UID, World

FULL = ApiError(403, "Forbidden", "exceeded quota: pods, requested: pods=1, used: pods=5")


def with_jobs(world: World, count: int) -> list[str]:
    """Their UIDs."""
    for number in range(count):
        job = make_job(f"job-{number}")
        world.api.put("jobs", job.object)
        world.view.put_job(job.view())
    return [f"uid-of-job-{number}" for number in range(count)]


@pytest.mark.parametrize(("jobs", "attempts"), [(1, 15), (500, 1000)])
async def test_refused_jobs_do_not_flood_the_api_server(jobs: int, attempts: int) -> None:
    """60 seconds of visits: one job is tried every 4 s, and 500 together ten times a second."""
    world = World()
    uids = with_jobs(world, jobs)
    world.api.fail("create pods", *[FULL] * (30 * jobs))
    for _ in range(30):
        for uid in uids:
            await world.reconciler.reconcile(uid)
        world.clock.advance(2)
    assert Counter(world.api.calls) == {
        "try pods": attempts,
        "create configmaps": jobs,
        "get configmaps": attempts - jobs,
        "create pods": attempts,
        "patch status": jobs,
        "create events": jobs,
    }
    assert Counter(world.api.event_reasons()) == {"QuotaExceeded": jobs}


async def test_a_job_whose_config_finds_no_room_waits_for_it() -> None:
    """Who resumes a job again and again has a ConfigMap for each time: a quota bounds them."""
    world = World()
    full = ApiError(403, "Forbidden", "exceeded quota: jobs, requested: count/configmaps=1")
    world.api.fail("create configmaps", full)
    await world.reconcile()
    assert world.reason("Accepted") == "False/QuotaExceeded"
    assert world.api.named("pods") == []
    await world.reconcile(after=4)
    assert world.reason("Accepted") == "True/DriverCreated"


async def test_a_job_that_is_edited_is_tried_at_once() -> None:
    world = World()
    world.api.fail("create pods", FULL)
    await world.reconcile()
    edited = world.api.objects["jobs", "x"]
    edited["metadata"]["generation"] = 2
    world.api.put("jobs", edited)
    world.deliver_job()
    await world.reconcile(after=0.1)
    assert world.reason("Accepted") == "True/DriverCreated"


async def test_what_was_mended_in_time_does_not_end_the_job() -> None:
    """However seldom each of many jobs is tried, none ends by a refusal of long ago."""
    world = World()
    uids = with_jobs(world, 400)
    world.api.fail("create pods", *[MISSING_ACCOUNT] * 401)
    for uid in [UID, *uids]:
        await world.reconciler.reconcile(uid)
    await world.reconcile(after=29)
    assert world.reason("Accepted") == "False/ServiceAccountMissing"
    await world.reconcile(after=1)
    assert world.reason("Accepted") == "True/DriverCreated"


async def test_a_config_that_went_while_there_was_no_room_is_made_again() -> None:
    world = World()
    world.api.fail("create pods", FULL)
    await world.reconcile()
    del world.api.objects["configmaps", world.config("x-1")["metadata"]["name"]]
    await world.reconcile(after=4)
    assert world.configs() == ["x-1"]
    assert world.reason("Accepted") == "True/DriverCreated"


async def test_a_lasting_refusal_has_a_patience_of_its_own() -> None:
    """A job that waited for quota for an hour is not ended by the first other refusal."""
    world = World()
    world.api.fail("create pods", *[FULL] * 1000)
    for _ in range(600):
        await world.reconcile(after=6)
    assert world.reason("Accepted") == "False/QuotaExceeded"
    world.api.faults["create pods"].clear()
    world.api.fail("create pods", *[MISSING_ACCOUNT] * 100)
    await world.reconcile(after=6)
    assert world.reason("Accepted") == "False/ServiceAccountMissing"
    for _ in range(4):
        await world.reconcile(after=6)
    assert world.reason("Failed") == "False/InProgress"
    for _ in range(2):
        await world.reconcile(after=6)
    assert world.reason("Failed") == "True/ServiceAccountMissing"


@pytest.mark.parametrize("what", ["a deadline", "a label", "the release"])
async def test_a_job_that_waits_for_quota_may_be_edited_and_the_release_upgraded(what: str) -> None:
    world = World()
    world.api.fail("create pods", *[FULL] * 3)
    for _ in range(3):
        await world.reconcile(after=5)
    assert world.reason("Accepted") == "False/QuotaExceeded"
    job = world.api.objects["jobs", "x"]
    if what == "the release":
        world.restart(settings=replace(world.settings, spark_image="r/spark:2"))
    elif what == "a label":
        job["metadata"].setdefault("labels", {})["commit"] = "8f3c1d2"
    else:
        job["spec"]["activeDeadline"] = "1h"
        job["metadata"]["generation"] = 2
    world.api.version += 1
    job["metadata"]["resourceVersion"] = str(world.api.version)
    world.deliver_job()
    await world.reconcile(after=5)
    assert world.reason("Accepted") == "True/DriverCreated"
    volumes = world.api.objects["pods", "x-1-driver"]["spec"]["volumes"]
    (mounted,) = [v["configMap"]["name"] for v in volumes if v["name"] == "config"]
    # What may be edited while a job runs is not in it; what results keep of a job is.
    assert world.api.named("configmaps").count(mounted) == 1
    assert len(world.api.named("configmaps")) == (1 if what == "a deadline" else 2)


async def test_a_name_that_the_api_server_can_t_look_up_ends_the_job_with_its_words() -> None:
    """It answers 500, which is else a fault that may pass, and was tried again for ever."""
    world = World()
    fault = ApiError(500, "", "invalid resource name \"a/b\": [may not contain '/']")
    world.api.fail("try pods", *[fault] * 20)
    await world.reconcile()
    assert world.reason("Accepted") == "False/CreationRefused"
    assert 'invalid resource name "a/b"' in world.message("Accepted")
    await world.reconcile(after=31)
    assert world.reason("Failed") == "True/CreationRefused"
