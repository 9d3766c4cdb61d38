"""Faults of the API server (a fake, see fakes.py): nothing is lost and nothing is done twice."""

import pytest

from bagpipe_operator.cluster.client import ApiError
from tests.unit.operator.builders import account, make_driver, make_job
from tests.unit.operator.fakes import not_found
from tests.unit.operator.world import UID, World


async def test_a_conflict_is_read_again_and_then_succeeds() -> None:
    world = World()
    world.api.objects["jobs", "x"]["metadata"]["resourceVersion"] = "8"
    with pytest.raises(ApiError, match="409"):
        await world.reconcile()
    assert world.status() == {}
    assert world.api.event_reasons() == []
    await world.reconcile()
    assert world.status()["phase"] == "Pending"
    assert world.api.event_reasons() == ["DriverCreated"]


async def test_a_job_that_is_gone_is_forgotten() -> None:
    world = World()
    del world.api.objects["jobs", "x"]
    await world.reconcile()
    assert world.view.job(UID) is None
    assert world.api.event_reasons() == []


async def test_of_a_job_that_a_write_finds_gone_nothing_is_kept() -> None:
    """Its deletion fell between two watches: no event brings another visit of it."""
    world = World()
    for used in (5, 6):
        full = f"exceeded quota: pods, used: pods={used}"
        world.api.fail("create pods", ApiError(403, "Forbidden", full))
    await world.reconcile()
    del world.api.objects["jobs", "x"]
    await world.reconcile(after=4)
    assert world.view.job(UID) is None
    assert world.reconciler._warm._crowds.now() == []
    assert world.reconciler._starts._refusals._held == {}
    assert world.reconciler._recorder._met == set()


# As of a proxy, or while the CRD is replaced.
NOT_SERVED = ApiError(404, "Unknown", "404 page not found")


@pytest.mark.parametrize("call", ["patch status", "get job"])
async def test_a_404_that_is_not_the_job_s_forgets_no_job(call: str) -> None:
    """Nobody would bring it back: its UID is that of one that is gone for good."""
    world = World(make_job("x").with_spec("activeDeadline", "60s"))
    await world.reconcile()
    world.deliver(make_driver("x").running())
    if call == "get job":
        world.api.fail("patch status", ApiError(409, "Conflict", "modified"))
    world.api.fail(call, NOT_SERVED)
    with pytest.raises(ApiError, match="404 page not found"):
        await world.reconcile(after=60)
    assert world.view.job(UID) is not None
    await world.reconcile()
    assert world.reason("Running") == "False/DeadlineExceeded"


async def test_a_404_that_is_not_the_earlier_job_s_ends_no_job() -> None:
    world = World(make_job("x").with_spec("resumeFrom", "y"))
    world.api.fail("get job", NOT_SERVED)
    with pytest.raises(ApiError, match="404 page not found"):
        await world.reconcile()
    assert world.status() == {}


async def test_a_404_that_is_not_the_driver_s_pod_s_loses_no_driver() -> None:
    world = World()
    await world.reconcile()
    del world.api.objects["pods", "x-1-driver"]
    await world.reconcile(after=2)
    world.api.fail("get pods", NOT_SERVED)
    with pytest.raises(ApiError, match="404 page not found"):
        await world.reconcile(after=30)
    assert world.status()["attempt"] == 1


async def test_of_a_job_that_its_removal_finds_gone_nothing_is_kept() -> None:
    world = World(make_job("x").with_spec("ttlAfterFinished", "60s"))
    await world.reconcile()
    world.deliver(make_driver("x").ended(0, account("Complete", verdict="Passed")))
    await world.reconcile()
    del world.api.objects["jobs", "x"]
    await world.reconcile(after=60)
    assert world.view.job(UID) is None
    assert world.reconciler._recorder._met == set()


async def test_a_namesake_is_not_written_to() -> None:
    world = World()
    other = make_job("x").object
    other["metadata"] |= {"uid": "another", "resourceVersion": "9"}
    world.api.put("jobs", other)
    with pytest.raises(ApiError, match="409"):
        await world.reconcile()
    assert world.view.job(UID) is None
    assert world.status() == {}


@pytest.mark.parametrize(
    "error",
    [
        ApiError(500, "InternalError", "etcdserver: leader changed"),
        ApiError(429, "TooManyRequests", "try again"),
        ApiError(0, "Unreachable", "timed out"),
        not_found("namespace"),
    ],
)
@pytest.mark.parametrize("call", ["create configmaps", "create pods"])
async def test_a_passing_fault_is_raised_and_leaves_no_mark(call: str, error: ApiError) -> None:
    world = World()
    world.api.fail(call, error)
    with pytest.raises(ApiError):
        await world.reconcile()
    assert world.status() == {}
    await world.reconcile()
    assert world.api.named("pods") == ["x-1-driver"]
    assert world.status()["phase"] == "Pending"


@pytest.mark.parametrize(
    "error",
    [
        ApiError(504, "Timeout", "etcdserver: request timed out"),
        ApiError(0, "Timeout", "no answer in time"),
        ApiError(403, "Forbidden", "configmaps is forbidden"),
    ],
)
@pytest.mark.parametrize("found", [True, False])
async def test_a_configmap_that_can_t_be_read_is_no_refusal_of_a_creation(
    error: ApiError, found: bool
) -> None:
    """No webhook is asked about what is only read."""
    world = World()
    if found:
        world.api.fail("create configmaps", ApiError(409, "AlreadyExists", "it exists"))
    else:
        full = ApiError(403, "Forbidden", "exceeded quota: pods, used: pods=5")
        world.api.fail("create pods", full)
        await world.reconcile()
    world.api.fail("get configmaps", error)
    with pytest.raises(ApiError, match=error.message):
        await world.reconcile(after=4)
    assert "CreationRefused" not in str(world.status())


async def test_an_event_that_can_not_be_written_stops_nothing() -> None:
    world = World()
    world.api.fail("create events", ApiError(403, "Forbidden", "exceeded quota: events"))
    await world.reconcile()
    assert world.status()["phase"] == "Pending"
    await world.reconcile()
    assert world.api.event_reasons() == []


@pytest.mark.parametrize(
    "error",
    [
        ApiError(500, "InternalError", "no"),
        ApiError(401, "Unauthorized", "Unauthorized"),
        ApiError(409, "Conflict", 'Operation cannot be fulfilled on resourcequotas "events"'),
    ],
)
async def test_an_event_that_can_not_be_written_now_is_written_later(error: ApiError) -> None:
    world = World()
    world.api.fail("create events", error)
    with pytest.raises(ApiError):
        await world.reconcile()
    assert world.status()["phase"] == "Pending"
    await world.reconcile()
    assert world.api.event_reasons() == ["DriverCreated"]


async def test_no_event_without_its_status() -> None:
    world = World()
    world.api.fail("patch status", ApiError(500, "InternalError", "no"))
    with pytest.raises(ApiError):
        await world.reconcile()
    assert world.api.event_reasons() == []


async def test_a_driver_that_can_not_be_deleted_is_deleted_later() -> None:
    world = World()
    await world.reconcile()
    world.deliver(make_driver("x").waiting("driver", "InvalidImageName"))
    await world.reconcile()
    world.api.fail("delete x-1-driver", ApiError(500, "InternalError", "no"))
    with pytest.raises(ApiError):
        await world.reconcile(after=30)
    assert world.reason("Failed") == "True/DriverImageUnavailable"
    await world.reconcile()
    assert world.api.named("pods") == []


async def test_a_late_watch_does_not_undo_what_was_written() -> None:
    world = World()
    stale = make_job("x").view()
    await world.reconcile()
    assert world.view.put_job(stale) is False
    await world.reconcile()
    assert world.api.calls.count("create pods") == 1
