"""Denials by admission webhooks, which choose the HTTP status of their answer themselves."""

import pytest

from bagpipe_operator.cluster.client import ApiError
from tests.unit.operator.builders import make_job
from tests.unit.operator.kueue.fake_kueue import QueueWorld
from tests.unit.operator.world import World

WORDS = 'admission webhook "pods.policy.example" denied the request: the store of secrets is away'
CODES = [(500, "InternalError"), (404, "NotFound"), (409, "Conflict"), (409, "AlreadyExists"),
         (429, "TooManyRequests"), (504, "Timeout")]  # fmt: skip
CALLS = ["try pods", "create configmaps", "create pods"]


@pytest.mark.parametrize("call", CALLS)
@pytest.mark.parametrize(("status", "reason"), CODES)
async def test_it_is_reported_and_the_job_starts_when_it_is_over(
    status: int, reason: str, call: str
) -> None:
    """100 visits in 100 minutes raised an error, and the job had no status."""
    world = World(make_job("x").with_spec("startDeadline", "10m"))
    for _ in range(5):
        world.api.faults[call] = [ApiError(status, reason, WORDS)]
        await world.reconcile(after=60)
    assert world.reason("Accepted") == "False/CreationRefused"
    assert WORDS in world.message("Accepted")
    assert world.api.event_reasons() == ["CreationRefused"]
    assert world.status()["phase"] == "Pending"
    world.api.faults.clear()
    await world.reconcile(after=60)
    assert world.reason("Accepted") == "True/DriverCreated"


@pytest.mark.parametrize(("status", "reason"), CODES)
async def test_the_start_deadline_counts_meanwhile(status: int, reason: str) -> None:
    world = World(make_job("x").with_spec("startDeadline", "10m"))
    for _ in range(11):
        world.api.faults["try pods"] = [ApiError(status, reason, WORDS)]
        await world.reconcile(after=60)
    assert world.reason("Failed") == "True/StartDeadlineExceeded"
    assert WORDS in world.message("Failed")


async def test_one_of_a_code_that_only_a_person_can_mend_ends_the_job() -> None:
    world = World()
    for _ in range(2):
        world.api.faults["try pods"] = [ApiError(403, "Forbidden", WORDS)]
        await world.reconcile(after=60)
    assert world.reason("Failed") == "True/CreationRefused"


@pytest.mark.parametrize("status", [500, 429, 409])
async def test_the_api_server_s_own_fault_of_that_code_is_tried_again_and_no_refusal(
    status: int,
) -> None:
    world = World()
    world.api.fail("create pods", ApiError(status, "Busy", "etcd has no leader"))
    with pytest.raises(ApiError, match="no leader"):
        await world.reconcile()


@pytest.mark.parametrize(("status", "reason"), CODES)
async def test_a_denied_workload_is_reported_and_asked_for_again(status: int, reason: str) -> None:
    world = QueueWorld()
    world.api.fail("create workloads", ApiError(status, reason, WORDS))
    await world.reconcile()
    assert world.reason("Accepted") == "False/QueueRefused"
    assert WORDS in world.message("Accepted")
    await world.reconcile(after=60)
    assert world.reason("Suspended") == "True/Queued"


@pytest.mark.parametrize(("status", "reason"), CODES)
def test_a_denial_is_no_sign_of_what_is_there(status: int, reason: str) -> None:
    denied = ApiError(status, reason, f'{WORDS}, as of "x"')
    assert not denied.is_gone("x")
    assert not denied.name_is_taken
    assert not denied.timed_out


async def test_a_policy_of_the_administrator_may_choose_its_code_as_well() -> None:
    """`reason: Unauthorized` of a ValidatingAdmissionPolicy, as Kubernetes writes it."""
    words = (
        "pods \"x-1-driver\" is forbidden: ValidatingAdmissionPolicy 'p' with binding 'b' denied"
        " request: no label"
    )
    world = World()
    for _ in range(3):
        world.api.faults["try pods"] = [ApiError(401, "Unauthorized", words)]
        await world.reconcile(after=60)
    assert world.reason("Accepted") == "False/CreationRefused"
    assert words in world.message("Accepted")
