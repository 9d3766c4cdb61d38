"""Two real operators and a real Lease: one leads, the other goes on, nothing is made twice.

How soon the other leads is for clocks that only a test moves: tests/unit/operator/test_election.py.
"""

import time

import pytest

from bagpipe_operator.settings import Settings
from tests.integration.control_plane.client import Client, core
from tests.integration.control_plane.conftest import StartOperator
from tests.integration.control_plane.fake_kubelet import FakeKubelet
from tests.integration.control_plane.observe import (
    await_lead,
    await_phase,
    children,
    create_jobs,
    expected_children,
    leads,
    limit_pods,
    moment,
    statuses,
)
from tests.integration.control_plane.release import Installation
from tests.unit.operator.builders import account
from tests.waiting import PATIENCE, wait_until

# So many drivers at most has the leader that is killed.
MOST_BEFORE = 30
NAMES = [f"j{number:03}" for number in range(60)]


def drivers_and_attempts(admin: Client, namespace: str) -> set[tuple[str, int]]:
    return {
        (name, status["attempt"])
        for name, status in statuses(admin, namespace).items()
        if status.get("driver") == f"{name}-1-driver"
    }


def test_the_leader_is_killed_in_the_middle_of_its_work(
    admin: Client,
    namespace: str,
    installation: Installation,
    kubelet: FakeKubelet,
    operator_process: StartOperator,
) -> None:
    # One worker makes the work last long enough to be interrupted; where the test is slower even
    # so, the quota keeps the leader from its end.
    quota = limit_pods(admin, namespace, "few", MOST_BEFORE)
    leader = operator_process(BAGPIPE_WORKERS="1")
    await_lead(leader)
    standby = operator_process()
    create_jobs(admin, namespace, NAMES)
    wait_until(
        lambda: len(children(admin, namespace)["pods"]) >= 10, PATIENCE, "no drivers were made"
    )
    lease = installation.lease
    renewed = moment(admin.get(lease)["spec"]["renewTime"])
    leader.kill()
    killed = time.monotonic()
    before = children(admin, namespace)["pods"]
    assert 10 <= len(before) <= MOST_BEFORE
    uids = {p["metadata"]["uid"] for p in admin.items(core(namespace, "pods"))}
    await_lead(standby)
    took = time.monotonic() - killed
    admin.delete(quota)
    waited = (moment(admin.get(lease)["spec"]["acquireTime"]) - renewed).total_seconds()
    assert waited > Settings.lease_seconds - 0.5, "it did not wait for the Lease's end"
    print(f"took over {took:.1f} s after the kill; had {len(before)} of {len(NAMES)} drivers")

    wanted = {(name, 1) for name in NAMES}
    wait_until(
        lambda: drivers_and_attempts(admin, namespace) == wanted, PATIENCE, "not each has a driver"
    )
    assert children(admin, namespace) == expected_children(NAMES)
    assert uids <= {p["metadata"]["uid"] for p in admin.items(core(namespace, "pods"))}
    for name in NAMES:
        kubelet.end(namespace, f"{name}-1-driver", 0, account("Complete", verdict="Passed"))
    await_phase(admin, namespace, "Complete", len(NAMES))
    assert {s["attempt"] for s in statuses(admin, namespace).values()} == {1}
    events = [e["involvedObject"]["name"] for e in admin.items(core(namespace, "events"))
            if e["reason"] == "DriverCreated"]  # fmt: skip
    assert len(events) == len(set(events)), "an Event was written twice"


def test_a_leader_that_stood_still_finds_another_and_writes_nothing(
    admin: Client, namespace: str, installation: Installation, operator_process: StartOperator
) -> None:
    # Only this namespace: the first must have nothing to do as long as it rightly leads.
    terms = {"BAGPIPE_WATCH_NAMESPACES": namespace}
    first = operator_process(**terms)
    await_lead(first)
    first.pause()
    # Begun only now, and with a long Lease: neither takes the other's where both are slow.
    second = operator_process(BAGPIPE_LEASE_SECONDS="30", **terms)
    await_lead(second)
    create_jobs(admin, namespace, ["a", "b"])
    await_phase(admin, namespace, "Pending", 2)
    first.resume()
    wait_until(lambda: not leads(first), PATIENCE, "the old leader believes in its Lease")
    wait_until(lambda: "does not lead any more" in first.logged(), PATIENCE, "it did not step back")
    create_jobs(admin, namespace, ["c"])
    await_phase(admin, namespace, "Pending", 3)
    assert leads(second)
    assert children(admin, namespace) == expected_children(["a", "b", "c"])
    lease = admin.get(installation.lease)
    assert lease["spec"]["leaseTransitions"] == 1
    assert first.metric('bagpipe_reconciles_total{result="done"}') == 0


@pytest.mark.usefixtures("bound_claims")
def test_a_replica_that_leads_a_second_time_starts_from_nothing(
    admin: Client,
    namespace: str,
    installation: Installation,
    kubelet: FakeKubelet,
    operator_process: StartOperator,
) -> None:
    """The image that the first saw missing was there while the second led, and is missing again."""
    # Longer than a busy machine needs for what comes between two looks at the pod.
    stuck = 20.0
    terms = {"BAGPIPE_WATCH_NAMESPACES": namespace}
    first = operator_process(BAGPIPE_STUCK_SECONDS=str(stuck), **terms)
    await_lead(first)
    create_jobs(admin, namespace, ["a"])
    await_phase(admin, namespace, "Pending", 1)
    kubelet.wait(namespace, "a-1-driver", "ErrImagePull", "no such image")
    await_reason(admin, namespace, "a", "DriverImageUnavailable")

    first.pause()
    # Begun only now: it takes the Lease of nobody who is only slow, and ends no job as stuck.
    second = operator_process(**terms)
    await_lead(second)
    kubelet.wait(namespace, "a-1-driver", "ContainerCreating")
    await_reason(admin, namespace, "a", "DriverPending")
    complete_job(admin, namespace, kubelet, "b")
    kubelet.wait(namespace, "a-1-driver", "ErrImagePull", "no such image")
    await_reason(admin, namespace, "a", "DriverImageUnavailable")
    second.kill()

    first.resume()
    # In its log: it leads again when the second's Lease is over, and is not seen not to lead then.
    wait_until(lambda: "does not lead any more" in first.logged(), PATIENCE, "it did not step back")
    await_lead(first)
    complete_job(admin, namespace, kubelet, "c")
    await_phase(admin, namespace, "Failed", 1)
    lease = admin.get(installation.lease)
    led = moment(lease["spec"]["acquireTime"])
    failed = moment(statuses(admin, namespace)["a"]["completionTime"])  # in whole seconds
    assert (failed - led).total_seconds() > stuck - 1, "it counted from when it led before"

    assert children(admin, namespace)["configmaps"] == ["a-1", "b-1", "c-1"]
    assert {s["attempt"] for s in statuses(admin, namespace).values()} == {1}
    events = [e["involvedObject"]["name"] for e in admin.items(core(namespace, "events"))
            if e["reason"] == "DriverCreated"]  # fmt: skip
    assert sorted(events) == ["a", "b", "c"]
    assert lease["spec"]["leaseTransitions"] == 2


def await_reason(admin: Client, namespace: str, name: str, reason: str) -> None:
    """Waits until a job's condition Running has a reason."""

    def is_reported() -> bool:
        conditions = statuses(admin, namespace)[name].get("conditions") or []
        return any(c["type"] == "Running" and c["reason"] == reason for c in conditions)

    wait_until(is_reported, PATIENCE, f"{name} did not become {reason}")


def complete_job(admin: Client, namespace: str, kubelet: FakeKubelet, name: str) -> None:
    """A job from its creation to its end, which whoever leads has written."""
    driver = f"{name}-1-driver"
    create_jobs(admin, namespace, [name])
    wait_until(
        lambda: admin.exists(core(namespace, "pods", driver)), PATIENCE, f"there is no {driver}"
    )
    kubelet.end(namespace, driver, 0, account("Complete", verdict="Passed"))
    wait_until(
        lambda: statuses(admin, namespace)[name].get("phase") == "Complete",
        PATIENCE,
        f"{name} did not become Complete",
    )


def test_a_leader_that_is_asked_to_end_gives_the_lease_back(
    admin: Client, namespace: str, installation: Installation, operator_process: StartOperator
) -> None:
    leader = operator_process(BAGPIPE_LEASE_SECONDS="30")
    await_lead(leader)
    standby = operator_process(BAGPIPE_LEASE_SECONDS="30")
    assert standby.ask("/readyz") == (200, "ok\n")
    create_jobs(admin, namespace, ["a"])
    await_phase(admin, namespace, "Pending", 1)
    leading = admin.get(installation.lease)["spec"]["holderIdentity"]
    assert leader.terminate() == 0
    # Nobody's, or the other's already: it would have been the leader's for 24 s more at least.
    assert admin.get(installation.lease)["spec"]["holderIdentity"] != leading
    assert "gave the Lease" in leader.logged()
    await_lead(standby)
    spec = admin.get(installation.lease)["spec"]
    assert spec["leaseTransitions"] == 1
    # The same for a lone one that is replaced: its successor need not wait for the Lease's end.
    assert standby.terminate() == 0
    leader.start()
    await_lead(leader)
    create_jobs(admin, namespace, ["b"])
    await_phase(admin, namespace, "Pending", 2)


def test_a_replica_without_the_right_to_the_lease_is_not_ready(
    operator_process: StartOperator,
) -> None:
    operator = operator_process(start=False, BAGPIPE_LEASE_NAMESPACE="default")
    operator.server.start()
    refused = 'User "system:serviceaccount:'

    def is_reported() -> bool:
        status, text = operator.ask("/readyz")
        return status == 503 and "the Lease default/bagpipe-operator can't be used: 403" in text

    wait_until(is_reported, PATIENCE, operator.logged())
    assert refused in operator.ask("/readyz")[1]
    assert operator.ask("/livez") == (200, "ok\n")
