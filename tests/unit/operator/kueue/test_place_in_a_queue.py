"""One job and its Workload: what is asked for it, when, and what is reported to Kueue."""

from typing import Any

import pytest

from bagpipe.spec import SimulationJobSpec
from bagpipe_operator.api.objects import Json
from bagpipe_operator.cluster.client import ApiError
from bagpipe_operator.cluster.large_objects import LARGE, SIZE, trimmed
from bagpipe_operator.jobs.job_view import JobView
from bagpipe_operator.jobs.kueue.queueing import Queueing
from bagpipe_operator.jobs.kueue.workload_view import Workloads, WorkloadView
from bagpipe_operator.jobs.pods.job_config import UnusableSpecError, read_spec
from bagpipe_operator.jobs.pods.refusal import Refusal
from bagpipe_operator.settings import Settings
from tests.unit.operator.builders import Clock, JobBuilder, make_job
from tests.unit.operator.kueue.fake_kueue import FakeKueueApi

RESERVED = {"QuotaReserved": ("True", "QuotaReserved", "")}
ADMITTED = RESERVED | {"Admitted": ("True", "Admitted", "")}
EVICTED = {"Evicted": ("True", "Preempted", "for what matters more")}
FINISHED = {"Finished": ("True", "Succeeded", "or so somebody says")}
QUEUED = ("Queued", "The job waits in the queue nightly of Kueue, which has not looked at it yet.")


def queued_job() -> JobBuilder:
    return make_job("x").with_spec("queueName", "nightly").with_executors(3)


def condition(type_: str, status: str = "True") -> Json:
    return {"type": type_, "status": status, "reason": "R", "message": "M."}


def in_state(*conditions: Json, **spec: Any) -> JobView:
    job = queued_job().with_status(conditions=list(conditions))
    for name, value in spec.items():
        job.with_spec(name, value)
    return job.view()


class Place:
    """A job's place, with a Kueue that the test moves and a watch that delivers at once."""

    def __init__(self) -> None:
        self.api, self.clock, self.workloads = FakeKueueApi(), Clock(), Workloads()
        self.queueing = Queueing(
            self.api, self.workloads, Settings(kueue=True), self.clock.now, self.clock.monotonic
        )
        self.job = queued_job().view()

    async def halt(self, after: float = 0.0) -> tuple[str, str] | None:
        self.clock.advance(after)
        halt = await self.queueing.halt(self.job)
        return (halt.reason, halt.message) if halt else None

    async def calls(self, after: float = 0.0) -> list[str]:
        """What a look at the job asks of the API server."""
        self.api.calls.clear()
        await self.halt(after)
        return self.api.calls

    async def settled(self, job: JobView) -> list[str]:
        self.api.calls.clear()
        await self.queueing.settle(job)
        return self.api.calls

    async def placed(self, spec: SimulationJobSpec | None = None) -> SimulationJobSpec | Refusal:
        return await self.queueing.placed(self.job, spec or read_spec(self.job))

    @property
    def name(self) -> str:
        [name] = self.api.named("workloads")
        return name

    def report(self, conditions: dict[str, tuple[str, str, str]], **status: object) -> None:
        """Kueue writes, and the watch delivers."""
        reported = self.api.report(self.name, conditions, **status)
        self.workloads.put(WorkloadView.from_object(reported))

    def seen(self) -> WorkloadView:
        found = self.workloads.find("lanes", self.name)
        assert found is not None
        return found

    def admit(self) -> None:
        flavors = [{"name": "driver", "flavors": {"cpu": "spot"}}]
        self.report(ADMITTED, admission={"podSetAssignments": flavors})


async def queued() -> Place:
    place = Place()
    assert await place.halt() == QUEUED
    return place


async def test_a_job_without_a_queue_waits_for_none() -> None:
    place = Place()
    place.job = make_job("x").view()
    assert (await place.halt(), place.api.calls) == (None, [])
    spec = read_spec(place.job)
    assert (await place.placed(spec), place.api.calls) == (spec, [])


async def test_a_workload_is_asked_for_every_thirty_seconds() -> None:
    place = await queued()
    assert place.api.calls == ["get workloads", "create workloads"]
    assert await place.calls() == []
    assert await place.calls(after=29.5) == []
    assert await place.calls(after=0.5) == ["get workloads"]
    assert await place.calls(after=35) == ["get workloads"]


async def test_a_workload_that_the_watch_has_lost_is_asked_for_at_once() -> None:
    place = await queued()
    place.workloads.drop(place.seen())
    assert await place.calls() == ["get workloads"]
    place.queueing.gone(place.job.uid)
    assert place.workloads.find("lanes", place.name) is None
    assert await place.calls() == ["get workloads"]


async def test_an_admitted_job_waits_for_nothing() -> None:
    place = await queued()
    place.report(RESERVED)
    assert await place.halt() is not None
    place.report(ADMITTED)
    assert await place.halt() is None


@pytest.mark.parametrize(
    ("status", "text"),
    [(status, "no") for status in (400, 403, 404, 413, 422)]
    + [(500, "failed calling webhook"), (504, "context deadline exceeded")],
)
async def test_a_refused_workload_is_reported_and_asked_for_again_later(
    status: int, text: str
) -> None:
    place = Place()
    place.api.fail("create workloads", ApiError(status, "", text))
    refused = ("QueueRefused", f"Its Workload can't be created: {text}")
    assert await place.halt() == refused
    assert await place.calls(after=29.5) == []
    assert await place.halt(after=0.4) == refused
    assert await place.halt(after=0.1) == QUEUED


@pytest.mark.parametrize("status", [0, 409, 429, 500])
async def test_a_fault_that_may_pass_refuses_nothing(status: int) -> None:
    place = Place()
    place.api.fail("create workloads", ApiError(status, "", "not now"))
    with pytest.raises(ApiError, match="not now"):
        await place.halt()
    assert await place.halt() == QUEUED
    place.api.fail("get workloads", ApiError(status, "", "not now"))
    with pytest.raises(ApiError, match="not now"):
        await place.halt(after=30)
    assert place.seen().name == place.name


async def test_what_is_wrong_with_a_spec_is_left_to_its_driver_s_creation() -> None:
    place = Place()
    place.job = queued_job().with_spec("stack.parameters", {"gain": 1}).view()
    assert await place.halt() is None
    assert place.api.named("workloads") == []


async def test_an_edit_that_changes_sizes_asks_for_another_place() -> None:
    place = await queued()
    place.job = queued_job().with_executors(5).view()
    assert await place.calls(after=30) == ["get workloads", "delete workload"]
    assert await place.calls() == ["get workloads", "create workloads"]
    # What it has quota for it keeps until its driver is to be created.
    place.report(RESERVED)
    place.job = queued_job().with_executors(6).view()
    assert await place.calls(after=30) == ["get workloads"]


async def test_a_large_job_is_read_once_for_each_edit_and_not_at_each_look() -> None:
    place = await queued()
    entire = queued_job().object | {SIZE: LARGE + 1}
    place.api.put("jobs", entire)
    for generation, calls in ((1, 1), (1, 0), (2, 1), (2, 0)):
        entire["metadata"]["generation"] = generation
        place.job = JobView.from_object(trimmed(entire))
        assert (await place.calls(after=30)).count("get job") == calls


async def test_a_driver_is_placed_where_its_quota_was_reserved() -> None:
    place = await queued()
    place.admit()
    place.api.put("flavors", {"metadata": {"name": "spot"}, "spec": {"nodeLabels": {"p": "spot"}}})
    spec = await place.placed()
    assert isinstance(spec, SimulationJobSpec)
    assert spec.spark.driver.pod.node_selector == {"p": "spot"}
    assert spec.spark.executor.pod.node_selector == {}
    assert spec.queue_name is None


@pytest.mark.parametrize("status", [403, 404])
async def test_a_flavor_that_can_t_be_read_keeps_the_job_from_its_start(status: int) -> None:
    place = await queued()
    place.admit()
    place.api.fail("get flavors", ApiError(status, "", "no"))
    refusal = await place.placed()
    assert isinstance(refusal, Refusal)
    assert (refusal.reason, refusal.lasting) == ("QueueRefused", False)
    place.api.fail("get flavors", ApiError(500, "", "not now"))
    with pytest.raises(ApiError, match="not now"):
        await place.placed()


async def test_a_flavor_that_no_pod_can_have_is_reported_as_such() -> None:
    place = await queued()
    place.admit()
    place.api.put("flavors", {"metadata": {"name": "spot"}, "spec": {"tolerations": 5}})
    with pytest.raises(UnusableSpecError, match="its queue's flavors can't be used"):
        await place.placed()


async def test_no_driver_begins_with_an_admission_that_was_taken_back() -> None:
    place = await queued()
    with pytest.raises(ApiError, match="409 Conflict: the queue has taken"):
        await place.placed()
    place.admit()
    place.api.report(place.name, EVICTED)  # and no watch has reported
    with pytest.raises(ApiError, match="409 Conflict: the queue has taken"):
        await place.placed()
    del place.api.objects["workloads", place.name]
    with pytest.raises(ApiError, match="409 Conflict: the queue has taken"):
        await place.placed()


async def test_no_driver_begins_with_an_admission_of_other_sizes() -> None:
    place = await queued()
    place.admit()
    place.job = queued_job().with_executors(5).view()
    with pytest.raises(ApiError, match="409 Conflict: the job was edited"):
        await place.placed()
    assert place.api.named("workloads") == []


async def test_the_end_of_a_job_is_reported_once() -> None:
    place = await queued()
    place.report(ADMITTED)
    done = in_state(condition("Complete"))
    assert await place.settled(done) == ["patch workload"]
    assert place.seen().holds("Finished")
    assert await place.settled(done) == []


async def test_a_job_without_a_workload_reports_nothing_to_kueue() -> None:
    place = Place()
    assert await place.settled(in_state(condition("Complete"))) == []
    await place.halt()
    going = place.api.objects["workloads", place.name]
    going["metadata"]["deletionTimestamp"] = "2026-11-20T04:00:00Z"
    place.workloads.put(WorkloadView.from_object(going))
    assert await place.settled(in_state(condition("Complete"))) == []


SUSPENDED = condition("Suspended")


@pytest.mark.parametrize(
    ("kueue", "suspend", "calls"),
    [
        (ADMITTED, True, ["delete workload"]),
        (FINISHED, False, ["delete workload"]),
        (RESERVED | EVICTED, False, ["patch workload"]),
        (EVICTED, False, []),
        (RESERVED, False, []),
    ],
)
async def test_what_a_job_without_pods_gives_back(
    kueue: dict[str, tuple[str, str, str]], suspend: bool, calls: list[str]
) -> None:
    place = await queued()
    place.report(kueue)
    assert await place.settled(in_state(SUSPENDED, suspend=suspend)) == calls


async def test_a_job_that_waits_in_its_queue_is_remembered_and_one_that_is_over_is_not() -> None:
    place = await queued()
    await place.settled(in_state(SUSPENDED))
    assert await place.calls() == []
    await place.settled(in_state(condition("Failed")))
    assert await place.calls() == ["get workloads"]


async def test_a_job_that_is_to_be_suspended_keeps_its_place_until_its_pods_are_gone() -> None:
    place = await queued()
    place.report(RESERVED | EVICTED)
    assert await place.settled(in_state(suspend=True)) == []


RUNS = condition("Running")


@pytest.mark.parametrize(
    ("conditions", "kueue", "calls"),
    [
        ([RUNS], ADMITTED, ["patch workload"]),
        ([RUNS], ADMITTED | {"PodsReady": ("True", "Started", "")}, []),
        ([RUNS], RESERVED, []),
        ([condition("Running", "False")], ADMITTED, []),
        ([], ADMITTED, []),
    ],
)
async def test_kueue_is_informed_when_the_cases_of_an_admitted_job_run(
    conditions: list[Json], kueue: dict[str, tuple[str, str, str]], calls: list[str]
) -> None:
    place = await queued()
    place.report(kueue)
    assert await place.settled(in_state(*conditions)) == calls


async def test_a_workload_that_was_written_meanwhile_is_read_and_patched_again() -> None:
    place = await queued()
    place.report(ADMITTED)
    place.api.report(place.name, {"Other": ("True", "Other", "")})  # and no watch has reported
    done = in_state(condition("Complete"))
    with pytest.raises(ApiError, match="modified"):
        await place.settled(done)
    assert place.seen().holds("Other")
    assert await place.settled(done) == ["patch workload"]


@pytest.mark.parametrize(
    ("status", "reason", "known"),
    [(404, "NotFound", False), (404, "", True), (500, "InternalError", True)],
)
async def test_a_workload_that_is_gone_receives_nothing_more(
    status: int, reason: str, known: bool
) -> None:
    place = await queued()
    place.report(ADMITTED)
    error = ApiError(status, reason, f'workloads.kueue.x-k8s.io "{place.name}" not found')
    place.api.fail("patch workload", error)
    with pytest.raises(ApiError, match="not found"):
        await place.settled(in_state(condition("Complete")))
    assert place.api.calls == ["patch workload"]
    assert (place.workloads.find("lanes", place.name) is not None) is known


async def test_a_priority_class_without_a_value_is_the_least() -> None:
    place = Place()
    job = queued_job()
    job.object["metadata"]["labels"] = {"kueue.x-k8s.io/priority-class": "plain"}
    place.job = job.view()
    place.api.put("priorities of kueue.x-k8s.io", {"metadata": {"name": "plain"}})
    await place.halt()
    assert place.api.objects["workloads", place.name]["spec"]["priority"] == 0
