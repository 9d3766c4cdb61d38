"""Jobs of a pool, one after the other, over the fakes: whose pods they run in, and until when."""

import asyncio
import contextlib
import json
from dataclasses import replace
from functools import partial
from typing import Any

import pytest

from bagpipe_operator.api import names
from bagpipe_operator.api.objects import Json
from bagpipe_operator.cluster.client import ApiError
from bagpipe_operator.cluster.lent_pods import may_lend_pods
from bagpipe_operator.jobs.claim import claim_of
from bagpipe_operator.jobs.job_view import JobView
from bagpipe_operator.jobs.pod_view import PodView
from bagpipe_operator.jobs.sweep import Sweeper
from bagpipe_operator.jobs.view import View
from bagpipe_operator.jobs.watch import Watch
from bagpipe_operator.runtime.metrics import Metrics
from bagpipe_operator.runtime.queue import WorkQueue
from bagpipe_operator.schedules.view import ScheduledJob
from bagpipe_operator.settings import Settings
from tests.unit.operator.builders import account, make_job
from tests.unit.operator.pools.pool_world import DRIVER, POOLS, World, pooled
from tests.waiting import PATIENCE


async def test_the_first_job_of_a_pool_has_pods_of_its_own_which_wait() -> None:
    world = World(pooled("one"))
    await world.run_the_first()
    assert world.status("one")["pool"] == {
        "name": "lane",
        "state": "Cold",
        "reason": "NoneWaits",
        "message": "No driver of pool lane waits in lanes.",
    }
    pod = world.api.objects["pods", "one-1-driver"]
    env = {each["name"]: each for each in pod["spec"]["containers"][0]["env"]}
    assert env["BAGPIPE_POOL_IDLE_SECONDS"]["value"] == "300"
    assert env["BAGPIPE_POD_UID"]["valueFrom"] == {"fieldRef": {"fieldPath": "metadata.uid"}}
    assert len(pod["metadata"]["annotations"][names.ANNOTATION_SHAPE]) == 64
    assert world.reason("one", "Complete") == "True/AllCasesRan"
    assert world.reason("one", "Passed") == "True/Passed"
    assert world.pods() == ["one-1-driver", "one-1-exec-1"]


async def test_the_next_job_runs_in_its_pods_from_the_first_visit_on() -> None:
    world = World(pooled("one"))
    await world.run_the_first()
    world.create(pooled("two"))
    await world.visit("two", after=60)
    assert world.pods() == ["one-1-driver", "one-1-exec-1"]
    status = world.status("two")
    claim = claim_of(status)
    assert claim is not None
    assert (claim.state, claim.driver, claim.pod) == ("Taken", DRIVER, "one-1-driver")
    assert (claim.job, claim.uid, claim.attempt) == ("one", "uid-of-one", 1)
    assert claim.digest == world.offers.digests[-1]
    assert (status["driver"], status["phase"]) == ("one-1-driver", "Planning")
    offered = world.offers.came[-1]
    assert (offered["name"], offered["uid"], offered["attempt"]) == ("two", "uid-of-two", 1)
    assert world.api.named("configmaps") == [
        name for name in world.api.named("configmaps") if name.startswith("one-1-")
    ]
    accepted = next(c for c in status["conditions"] if c["type"] == "Accepted")
    assert accepted["message"] == "The driver's pod is one-1-driver, which was made for job one."
    world.says("two")
    await world.visit("two", after=2)
    assert world.reason("two", "Running") == "True/CasesRunning"
    world.says("two", "Complete", ended=True, verdict="Failed", reason="AllCasesRan")
    await world.visit("two", after=2)
    assert world.reason("two", "Complete") == "True/AllCasesRan"
    assert world.status("two")["verdict"] == "Failed"
    assert world.status("one")["verdict"] == "Passed"
    assert world.pods() == ["one-1-driver", "one-1-exec-1"]


async def test_what_the_driver_says_of_the_job_before_is_no_account_of_the_next() -> None:
    world = World(pooled("one"))
    await world.run_the_first()
    world.create(pooled("two"))
    await world.visit("two", after=1)
    for _ in range(5):
        await world.visit("two", after=2)  # the driver still answers for the first
    assert world.status("two")["phase"] == "Planning"
    assert world.reason("two", "Complete") == "False/InProgress"


async def test_a_pod_that_dies_with_the_last_word_of_the_job_before_has_lost_the_next() -> None:
    world = World(pooled("one"))
    await world.run_the_first()
    world.create(pooled("two"))
    await world.visit("two", after=1)
    pod = world.api.objects["pods", "one-1-driver"]
    word = account("Complete", uid="uid-of-one", attempt=1, verdict="Passed")
    ended = {"exitCode": 0, "reason": "Completed", "message": word}
    pod["status"] |= {
        "phase": "Succeeded",
        "containerStatuses": [{"name": "driver", "state": {"terminated": ended}}],
    }
    world.view.put_pod(PodView.from_object(pod))
    await world.visit("two", after=1)
    assert world.status("two")["phase"] == "Pending"
    assert (world.status("two")["attempt"], world.status("two")["lostDrivers"]) == (2, 1)
    assert world.reason("two", "Running") == "False/DriverFailed"
    await world.visit("two", after=11)
    assert "two-2-driver" in world.pods()  # cold: only a job's first attempt is handed over


@pytest.mark.parametrize(
    ("changed", "reason"),
    [
        ({"stack.image": "example/lane:2"}, "PodsDiffer"),
        ({"spark.slots": 2}, "PodsDiffer"),
        ({"storage.secrets": ["other"]}, "PodsDiffer"),
        ({"spark.pool": "another"}, "NoneWaits"),
        ({"stack.imagePullPolicy": "Always"}, "ImagePulled"),
        ({"queueName": "team"}, "Queued"),
    ],
)
async def test_another_job_has_pods_of_its_own(changed: Json, reason: str) -> None:
    world = World(pooled("one"))
    await world.run_the_first()
    job = pooled("two")
    for path, value in changed.items():
        job = job.with_spec(path, value)
    world.create(job)
    await world.visit("two", after=1)
    assert (world.status("two")["pool"]["state"], world.offers.came) == ("Cold", [])
    assert world.status("two")["pool"]["reason"] == reason
    assert "two-1-driver" in world.pods()


async def test_where_pools_are_off_no_driver_waits() -> None:
    world = World(pooled("one"), settings=Settings())
    await world.visit("one")
    assert world.status("one")["pool"]["reason"] == "PoolsOff"
    pod = world.api.objects["pods", "one-1-driver"]
    assert names.ANNOTATION_SHAPE not in pod["metadata"]["annotations"]
    assert "BAGPIPE_POOL" not in json.dumps(pod)


async def test_a_job_without_a_pool_costs_no_further_call() -> None:
    world = World(make_job("one"))
    await world.visit("one")
    assert "pool" not in world.status("one")
    assert world.api.calls == [
        "try pods", "create configmaps", "create pods", "patch status", "create events",
    ]  # fmt: skip


async def test_what_the_administrator_forbids_is_not_offered_either() -> None:
    """A job that would be refused cold is not run warm."""
    world = World(pooled("one"))
    await world.run_the_first()
    world.settings = Settings(pools=True, storage_hosts=("s3.example.com",))
    world.restart()
    world.create(pooled("two").with_spec("output.uri", "hdfs://elsewhere:8020/results"))
    await world.visit("two", after=1)
    assert (world.reason("two", "Failed"), world.offers.came) == ("True/SpecInvalid", [])


async def test_a_driver_that_refuses_leaves_the_job_to_pods_of_its_own() -> None:
    world = World(pooled("one"))
    await world.run_the_first()
    world.offers.answers = ["refused"]
    world.create(pooled("two"))
    await world.visit("two", after=1)
    assert world.status("two")["pool"]["reason"] == "DriverRefused"
    assert "two-1-driver" in world.pods()


async def test_a_driver_that_is_silent_for_too_long_is_ended_before_another_is_made() -> None:
    world = World(pooled("one"))
    await world.run_the_first()
    world.offers.answers = ["silent"]
    world.create(pooled("two"))
    for _ in range(5):
        await world.visit("two", after=1.9)
        assert world.status("two")["pool"]["state"] == "Offered"
        assert world.pods() == ["one-1-driver", "one-1-exec-1"]
    await world.visit("two", after=2)
    assert world.status("two")["pool"]["state"] == "Fenced"
    assert "delete one-1-driver" in world.api.calls
    await world.visit("two", after=2)
    assert world.status("two")["pool"]["reason"] == "DriverGone"
    assert "two-1-driver" in world.pods()


async def test_an_answer_that_was_lost_is_asked_for_again_by_another_operator() -> None:
    world = World(pooled("one"))
    await world.run_the_first()
    world.offers.answers = ["silent"]
    world.create(pooled("two"))
    await world.visit("two", after=1)
    first = world.offers.digests[-1]
    world.offers.answers = ["ended"]
    world.says("two", "Complete", ended=True, verdict="Passed", reason="AllCasesRan")
    world.restart(fresh=True)
    await world.visit("two", after=2)
    assert world.offers.digests[-1] == first
    assert world.reason("two", "Complete") == "True/AllCasesRan"
    assert "two-1-driver" not in world.pods()


async def test_a_suspended_job_is_run_by_nobody() -> None:
    world = World(pooled("one"))
    await world.run_the_first()
    world.offers.answers = ["silent"]
    world.create(pooled("two"))
    await world.visit("two", after=1)
    world.suspend("two")
    for _ in range(3):
        await world.visit("two", after=1)
    assert "one-1-driver" not in world.pods()
    assert world.status("two")["pool"]["state"] == "Cold"
    assert world.reason("two", "Suspended").startswith("True/")


async def test_a_suspended_job_gives_the_pods_back_that_were_made_for_another() -> None:
    world = World(pooled("one"))
    await world.run_the_first()
    world.create(pooled("two"))
    await world.visit("two", after=1)
    world.says("two")
    await world.visit("two", after=2)
    world.suspend("two")
    await world.visit("two", after=1)
    assert "one-1-driver" not in world.pods()
    world.goes("one-1-driver")
    world.goes("one-1-exec-1")
    await world.visit("two", after=1)
    assert world.reason("two", "Suspended").startswith("True/")
    assert world.status("two")["attempt"] == 2


async def test_a_driver_waits_for_so_long_and_no_longer() -> None:
    world = World(pooled("one"))
    await world.run_the_first()
    await world.visit("one", after=329)
    assert "one-1-driver" in world.pods()
    await world.visit("one", after=1)  # it should have ended by itself 30 s ago
    assert world.pods() == []


async def test_no_more_wait_than_a_namespace_may_keep() -> None:
    world = World(*(pooled(name, f"pool-{name}") for name in ("one", "two", "three")))
    for name in ("one", "two", "three"):
        await world.visit(name, after=1)
        world.run(f"{name}-1-driver")
        done = account("Complete", uid=f"uid-of-{name}", attempt=1, ended=True, verdict="Passed")
        world.drivers.says[f"uid-of-{name}-1-driver"] = done
        await world.visit(name, after=2)
    await world.visit("one", after=2)
    assert world.pods() == [
        "three-1-driver", "three-1-exec-1", "two-1-driver", "two-1-exec-1",
    ]  # fmt: skip


async def test_those_that_wait_give_their_place_to_a_job_without_room() -> None:
    world = World(pooled("one"))
    await world.run_the_first()
    world.create(make_job("big"))
    await world.visit("big", after=1)
    pod = world.api.objects["pods", "big-1-driver"]
    why = {"type": "PodScheduled", "status": "False", "reason": "Unschedulable", "message": "full"}
    pod["status"] = {"phase": "Pending", "conditions": [why]}
    world.view.put_pod(PodView.from_object(pod))
    await world.visit("big", after=1)
    await world.visit("one", after=1)
    assert world.pods() == ["big-1-driver"]


async def test_a_job_that_failed_keeps_nobody() -> None:
    world = World(pooled("one"))
    await world.visit("one")
    world.run("one-1-driver")
    pod = world.api.objects["pods", "one-1-driver"]
    word = account("Failed", uid="uid-of-one", attempt=1, reason="CasesErrored")
    ended = {"exitCode": 1, "reason": "Error", "message": word}
    pod["status"] |= {"containerStatuses": [{"name": "driver", "state": {"terminated": ended}}]}
    world.view.put_pod(PodView.from_object(pod))
    await world.visit("one", after=1)
    assert world.reason("one", "Failed") == "True/CasesErrored"
    assert "one-1-exec-1" not in world.pods()
    world.create(pooled("two"))
    await world.visit("two", after=1)
    assert world.status("two")["pool"]["reason"] == "NoneWaits"


async def test_an_expired_job_stays_as_long_as_its_driver_which_may_run_another() -> None:
    world = World(pooled("one").with_spec("ttlAfterFinished", "10s"))
    await world.run_the_first()
    world.create(pooled("two").with_spec("ttlAfterFinished", "10s"))
    await world.visit("two", after=1)
    world.says("two")
    await world.visit("one", after=60)
    assert ("jobs", "one") in world.api.objects
    world.says("two", "Complete", ended=True, verdict="Passed")
    await world.visit("two", after=2)
    await world.visit("two", after=20)
    assert ("jobs", "two") not in world.api.objects
    await world.visit("one", after=2)
    assert ("jobs", "one") in world.api.objects
    world.api.objects["pods", "one-1-driver"]["status"]["phase"] = "Succeeded"
    await world.visit("one", after=2)
    assert ("jobs", "one") not in world.api.objects


@pytest.mark.parametrize("silent", [False, True])
async def test_an_operator_that_starts_ends_no_driver_whose_job_it_has_not_listed_yet(
    silent: bool,
) -> None:
    """The pages of a list come one after the other, and the pods' may come first."""
    world = World(pooled("one").with_spec("ttlAfterFinished", "10s"))
    await world.run_the_first()
    world.create(pooled("two"))
    await world.visit("two", after=1)
    world.says("two")
    await world.visit("two", after=1)
    world.restart(fresh=True)
    world.view.drop_job("uid-of-two")
    world.drivers.silent = silent
    await world.visit("one", after=400)
    await world.visit("one", after=29.9)
    assert world.pods() == ["one-1-driver", "one-1-exec-1"]
    assert ("jobs", "one") in world.api.objects
    await world.visit("one", after=0.1)
    assert ("one-1-driver" in world.pods()) is not silent


async def test_executors_are_not_ended_before_their_driver_is_listed() -> None:
    world = World(pooled("one"))
    await world.run_the_first()
    world.restart(fresh=True)
    driver = next(pod for pod in world.view.all_pods() if pod.uid == DRIVER)
    world.view.drop_pod(driver)
    await world.visit("one", after=1)
    assert world.pods() == ["one-1-driver", "one-1-exec-1"]
    del world.api.objects["pods", "one-1-driver"]
    await world.visit("one", after=1)
    assert world.pods() == []


async def test_a_schedule_knows_of_each_job_which_driver_may_run_another() -> None:
    world = World(pooled("one"), make_job("plain"))
    await world.run_the_first()
    await world.visit("plain")
    world.create(pooled("two"))
    await world.visit("two", after=1)
    for name, driver in (("one", "one-1-driver"), ("two", ""), ("plain", "")):
        assert ScheduledJob.from_object(world.api.objects["jobs", name]).pool_driver == driver


async def test_only_a_pod_that_runs_for_that_very_job_is_lent() -> None:
    world = World(pooled("one"))
    await world.run_the_first()
    lends = partial(may_lend_pods, world.api, "lanes")
    assert await lends("one-1-driver", "uid-of-one")
    assert not await lends("one-1-driver", "uid-of-its-namesake")
    assert not await lends("two-1-driver", "uid-of-two")
    world.api.objects["pods", "one-1-driver"]["metadata"]["deletionTimestamp"] = "now"
    assert not await lends("one-1-driver", "uid-of-one")
    world.api.fail("get pods", ApiError(0, "Unreachable", "no answer"))
    with pytest.raises(ApiError):
        await lends("one-1-driver", "uid-of-one")


async def test_a_job_whose_pods_go_with_another_job_goes_on_and_nothing_is_counted() -> None:
    world = World(pooled("one"))
    await world.run_the_first()
    world.create(pooled("two"))
    await world.visit("two", after=1)
    del world.api.objects["jobs", "one"]
    world.view.drop_job("uid-of-one")
    await world.visit("one")
    world.goes("one-1-driver")
    await world.visit("two", after=1)
    status = world.status("two")
    assert (status["attempt"], status["lostDrivers"]) == (2, 0)
    await world.visit("two", after=11)
    assert "two-2-driver" in world.pods()
    assert world.view.pods("uid-of-two")[0].name == "two-2-driver"


async def test_a_job_that_is_deleted_in_the_foreground_counts_against_no_other() -> None:
    """It is there, and in the view, until its pods are gone."""
    world = World(pooled("one"))
    await world.run_the_first()
    world.create(pooled("two"))
    await world.visit("two", after=1)
    world.api.objects["jobs", "one"]["metadata"]["deletionTimestamp"] = "2026-11-25T00:00:00Z"
    world.goes("one-1-driver")
    await world.visit("two", after=1)
    assert (world.status("two")["attempt"], world.status("two")["lostDrivers"]) == (2, 0)


async def test_a_driver_that_is_lost_while_its_first_job_stays_counts() -> None:
    world = World(pooled("one"))
    await world.run_the_first()
    world.create(pooled("two"))
    await world.visit("two", after=1)
    world.view.drop_job("uid-of-one")  # as before all are listed
    world.goes("one-1-driver")
    await world.visit("two", after=1)
    assert (world.status("two")["attempt"], world.status("two")["lostDrivers"]) == (2, 1)


async def test_what_became_forbidden_while_a_driver_was_asked_is_not_asked_again() -> None:
    """An operator with other rules has started: the job ends by them, and no driver runs it."""
    one, two = (
        pooled(name).with_spec("output.uri", "hdfs://elsewhere:8020/results")
        for name in ("one", "two")
    )
    world = World(one)
    await world.run_the_first()
    world.offers.answers = ["silent"]
    world.create(two)
    await world.visit("two", after=1)
    assert world.status("two")["pool"]["state"] == "Offered"
    asked = len(world.offers.came)
    world.settings = replace(POOLS, storage_hosts=("s3.example.com",))
    world.restart(fresh=True)
    await world.visit("two", after=9)
    assert world.status("two")["pool"]["state"] == "Offered"
    await world.visit("two", after=1)
    assert world.status("two")["pool"]["state"] == "Fenced"
    await world.visit("two", after=2)
    assert world.reason("two", "Failed") == "True/SpecInvalid"
    assert (len(world.offers.came), "two-1-driver" in world.pods()) == (asked, False)


async def test_a_halt_is_complete_only_once_the_driver_that_was_asked_is_gone() -> None:
    world = World(pooled("one"))
    await world.run_the_first()
    world.offers.answers = ["silent"]
    world.create(pooled("two"))
    await world.visit("two", after=1)
    world.api.terminating = True
    world.suspend("two")
    for _ in range(3):
        await world.visit("two", after=1)
        assert world.reason("two", "Suspended") == "False/Suspending"
    assert world.status("two")["pool"]["state"] == "Fenced"
    world.goes("one-1-driver")
    await world.visit("two", after=1)
    assert world.reason("two", "Suspended").startswith("True/")


async def test_two_jobs_that_are_looked_at_together_choose_two_drivers(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    world = World(*(pooled(name) for name in ("one", "six")))
    for name in ("one", "six"):
        await world.visit(name, after=1)
    for name in ("one", "six"):
        world.run(f"{name}-1-driver")
        done = account("Complete", uid=f"uid-of-{name}", attempt=1, ended=True, verdict="Passed")
        world.drivers.says[f"uid-of-{name}-1-driver"] = done
        await world.visit(name, after=2)
    world.offers.answers = ["silent"]
    for name in ("two", "three"):
        world.create(pooled(name))
    chosen, both_have_chosen = 0, asyncio.Event()
    written = world.api.patch_status

    async def later(*given: Any, **more: Any) -> Any:
        nonlocal chosen
        chosen += 1
        if chosen == 2:
            both_have_chosen.set()
        async with asyncio.timeout(PATIENCE):
            await both_have_chosen.wait()
        return await written(*given, **more)

    monkeypatch.setattr(world.api, "patch_status", later)
    await asyncio.gather(world.visit("two"), world.visit("three"))
    pods = [world.status(name)["pool"].get("pod") for name in ("two", "three")]
    assert sorted(map(str, pods)) == ["one-1-driver", "six-1-driver"]


async def test_a_job_whose_claim_could_not_be_written_claims_the_same_driver_again() -> None:
    world = World(pooled("one"))
    await world.run_the_first()
    world.create(pooled("two"))
    world.api.fail("patch status", ApiError(500, "InternalError", "not now"))
    with pytest.raises(ApiError):
        await world.visit("two", after=1)
    assert "pool" not in world.status("two")
    await world.visit("two", after=1)
    assert world.status("two")["pool"]["state"] == "Taken"


async def test_a_driver_that_was_chosen_for_a_job_that_is_gone_is_there_for_the_next() -> None:
    world = World(pooled("one"))
    await world.run_the_first()
    world.create(pooled("two"))
    world.api.fail("patch status", ApiError(404, "NotFound", '"two" not found'))
    del world.api.objects["jobs", "two"]
    with contextlib.suppress(ApiError):
        await world.visit("two", after=1)
    await world.visit("two", after=1)
    world.create(pooled("three"))
    await world.visit("three", after=1)
    assert world.status("three")["pool"]["state"] == "Taken"


async def test_a_job_that_was_taken_gets_no_pods_of_its_own_while_its_driver_is_out_of_sight() -> (
    None
):
    """The operator was killed after it wrote the claim, and its watch has brought no pod yet."""
    world = World(pooled("one"))
    await world.run_the_first()
    world.create(pooled("two"))
    await world.visit("two", after=1)
    job = world.api.objects["jobs", "two"]
    job["status"] = {"pool": job["status"]["pool"]}
    world.view = View()
    for name in ("one", "two"):
        world.view.put_job(JobView.from_object(world.api.objects["jobs", name]))
    world.restart()
    for _ in range(8):
        await world.visit("two", after=2)
        assert "two-1-driver" not in world.pods()
    assert (world.status("two")["attempt"], world.status("two")["driver"]) == (1, "one-1-driver")


async def test_a_driver_that_two_have_claimed_is_not_taken_from_the_one_that_has_it() -> None:
    """Both claimed it while the watch was behind; the other one is suspended before an answer."""
    world = World(pooled("one"))
    await world.run_the_first()
    world.offers.answers = ["silent"]
    world.create(pooled("two"))
    await world.visit("two", after=1)
    offered = dict(world.status("two")["pool"])
    three = pooled("three").with_status(pool=offered).with_spec("suspend", True)
    world.offers.answers = ["taken"]
    await world.visit("two", after=1)
    world.create(three)
    await world.visit("three", after=1)
    assert world.status("three")["pool"]["reason"] == "DriverRefused"
    assert "one-1-driver" in world.pods()


async def test_a_driver_that_was_promised_is_promised_once() -> None:
    world = World(pooled("one"))
    await world.run_the_first()
    world.offers.answers = ["silent"]
    for name in ("two", "three"):
        world.create(pooled(name))
        await world.visit(name, after=1)
    assert world.status("two")["pool"]["state"] == "Offered"
    assert world.status("three")["pool"]["reason"] == "NoneWaits"
    assert "three-1-driver" in world.pods()


async def test_a_pod_that_somebody_made_with_a_driver_s_labels_is_offered_nothing() -> None:
    world = World(pooled("one"))
    await world.run_the_first()
    forged = json.loads(json.dumps(world.api.objects["pods", "one-1-driver"]))
    forged["metadata"] |= {"name": "copy-1-driver", "uid": "forged"}
    world.goes("one-1-driver")
    world.api.put("pods", forged)
    world.view.put_pod(PodView.from_object(forged))
    world.create(pooled("two"))
    await world.visit("two", after=1)
    assert (world.status("two")["pool"]["reason"], world.offers.came) == ("NoneWaits", [])


async def test_events_of_pods_bring_forward_the_job_that_runs_in_them() -> None:
    world = World(pooled("one"))
    await world.run_the_first()
    world.create(pooled("two"))
    await world.visit("two", after=1)
    queue = WorkQueue()
    watch = Watch(world.view, queue, Metrics())
    pod = json.loads(json.dumps(world.api.objects["pods", "one-1-driver"]))
    pod["status"]["message"] = "news"
    pod["metadata"]["resourceVersion"] = "999"
    watch.pod_event({"type": "MODIFIED", "object": pod})
    assert await queue.get() == "uid-of-two"


async def test_jobs_whose_drivers_wait_are_visited() -> None:
    world = World(pooled("one"), make_job("plain"))
    await world.run_the_first()
    queue = WorkQueue()
    sweeper = Sweeper(world.view, queue, 2.0, now=world.clock.now)
    sweeper.sweep()
    assert await queue.get() == "uid-of-one"


async def test_how_jobs_began_and_how_many_drivers_wait_is_counted() -> None:
    world = World(pooled("one"))
    await world.run_the_first()
    value = world.metrics.registry.get_sample_value
    assert value("bagpipe_pool_drivers_waiting") == 1
    world.create(pooled("two"))
    await world.visit("two", after=1)
    world.create(pooled("three"))
    await world.visit("three", after=1)
    assert value("bagpipe_pool_drivers_waiting") == 0
    counts = [value("bagpipe_pool_jobs_total", {"how": how})
              for how in ("Taken", "NoneWaits", "PodsDiffer")]  # fmt: skip
    assert counts == [1, 2, 0]
