"""Who may write labels or ConfigMaps, and nothing more, does not steer another's job."""

from dataclasses import replace

import pytest

from bagpipe_operator.cluster.client import ApiError
from bagpipe_operator.jobs.metrics import JobMetrics
from bagpipe_operator.jobs.pod_view import PodView
from bagpipe_operator.jobs.watch import Watch
from bagpipe_operator.runtime.queue import WorkQueue
from tests.unit.operator.builders import START, account, make_driver, make_executor, make_job
from tests.unit.operator.world import UID, World


def in_another_namespace(job: str) -> PodView:
    """A pod that calls itself the job's driver, where its author may make pods."""
    pod = make_driver(job).running().object()
    pod["metadata"] |= {"namespace": "attackers", "uid": "uid-of-forged"}
    return PodView.from_object(pod)


def test_a_pod_of_another_namespace_is_not_a_job_s() -> None:
    world = World()
    world.view.put_pod(in_another_namespace("x"))
    assert world.view.pods(UID) == ()
    assert world.view.driver(UID, 1) is None
    # Nor does it stand in the way of the real one, whose name it has.
    world.view.put_pod(make_driver("x").running().view())
    world.view.put_pod(in_another_namespace("x"))
    driver = world.view.driver(UID, 1)
    assert driver is not None
    assert (driver.namespace, driver.uid) == ("lanes", "uid-of-x-1-driver")
    world.view.drop_pod(in_another_namespace("x"))
    assert world.view.driver(UID, 1) == driver


def test_pods_of_another_namespace_cost_a_job_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    """Each visit sorted and filtered all that had its UID, and each of them asked for a visit."""
    world, queue = World(), WorkQueue()
    view = world.view
    for number in range(1_000):
        view.put_pod(replace(in_another_namespace("x"), name=f"p{number}"))
    with monkeypatch.context() as counts:
        looked: list[PodView] = []
        counts.setattr("bagpipe_operator.jobs.view._is_of", lambda _, pod: looked.append(pod))
        view.pods(UID)
    assert len(looked) == 0
    watch = Watch(view, queue, JobMetrics(view, queue))
    forged = make_driver("x").running().object()
    forged["metadata"] |= {"namespace": "attackers", "uid": "uid-of-forged"}
    watch.pod_event({"type": "ADDED", "object": forged})
    watch.pod_event({"type": "DELETED", "object": forged})
    assert len(queue) == 0
    watch.pod_event({"type": "ADDED", "object": make_driver("x").running().object()})
    assert len(queue) == 1


async def test_a_forged_driver_of_another_namespace_ends_no_job() -> None:
    world = World()
    await world.reconcile()
    forged = make_driver("x").ended(0, account("Complete", verdict="Passed")).object()
    forged["metadata"] |= {"namespace": "attackers", "uid": "uid-of-forged"}
    world.view.put_pod(PodView.from_object(forged))
    await world.reconcile(after=2)
    assert world.status()["phase"] == "Pending"
    assert "delete x-1-driver" not in world.api.calls


async def test_a_pod_of_another_namespace_explains_no_job_s_end() -> None:
    """Nor does its end count: the last pods that went are asked why executors do."""
    world = World()
    await world.reconcile()
    world.deliver(make_driver("x").running())
    world.drivers.says = account()
    killed = make_executor("x").ended(137, reason="OOMKilled")
    killed.with_container(
        "spark",
        {"terminated": {"exitCode": 137, "reason": "OOMKilled", "finishedAt": START.isoformat()}},
    )
    forged = killed.object()
    forged["metadata"] |= {"namespace": "attackers", "uid": "uid-of-forged"}
    for pod in (PodView.from_object(forged), killed.view()):
        world.view.put_pod(pod)
        world.view.drop_pod(pod)
        await world.reconcile(after=2)
        foreign = pod.namespace == "attackers"
        assert ("ExecutorOutOfMemory" in world.reason("Running")) is not foreign


async def test_an_executor_of_another_job_s_driver_steers_no_job_by_its_uid() -> None:
    """A driver's token makes executors with its own job's name, and with whatever UID."""
    world = World()
    await world.reconcile()
    world.deliver(make_driver("x").running(), make_executor("x").running())
    world.drivers.says = account()
    await world.reconcile(after=2)
    forged = make_executor("y").waiting("stack", "ErrImageNeverPull", "none").object()
    forged["metadata"]["labels"]["sim.bagpipe.io/job-uid"] = UID
    world.view.put_pod(PodView.from_object(forged))
    assert [pod.name for pod in world.view.pods(UID)] == ["x-1-driver", "x-1-exec-1"]
    for _ in range(30):
        await world.reconcile(after=2)
    assert world.reason("Running") == "True/CasesRunning"
    world.view.drop_pod(PodView.from_object(forged))
    assert world.view.gone_pods(UID) == ()


async def test_a_prepared_config_is_not_taken_for_ours() -> None:
    """Who may create ConfigMaps, but no pods, knows the name and the UID of the next attempt's."""
    for forged in ({"executor.yaml": "spec: {hostPID: true}"}, None):
        world = World()
        await world.reconcile()
        config = world.config("x-1")
        del world.api.objects["pods", "x-1-driver"]
        if forged is None:
            config["immutable"] = False  # right today, and another tomorrow
        else:
            config["data"] = config["data"] | forged
        again = World()
        again.api.put("configmaps", config)
        await again.reconcile()
        assert again.reason("Accepted") == "False/NameTaken"
        assert again.api.named("pods") == []


async def test_a_config_that_was_exchanged_while_there_was_no_room_is_not_ours() -> None:
    """A quota may refuse the driver for hours after its ConfigMap was made."""
    world = World()
    world.api.fail("create pods", ApiError(403, "Forbidden", "exceeded quota: pods"))
    await world.reconcile()
    config = world.config("x-1")
    config["data"] = config["data"] | {"executor.yaml": "spec: {hostPID: true}"}
    await world.reconcile(after=4)
    assert world.reason("Accepted") == "False/NameTaken"
    assert world.api.named("pods") == []


async def test_a_config_that_a_former_run_made_is_taken_over() -> None:
    world = World()
    await world.reconcile()
    again = World()
    again.api.put("configmaps", world.config("x-1"))
    await again.reconcile()
    assert again.api.named("pods") == ["x-1-driver"]


async def test_what_no_executor_may_be_is_reported_before_a_driver_exists() -> None:
    """Spark itself would only log the refusal and try again for ever."""
    job = make_job("x").with_spec("stack.securityContext", {"runAsNonRoot": False})
    world = World(job)
    text = 'pods "x-1-exec-trial" is forbidden: violates PodSecurity "restricted:latest"'
    world.api.fail("try pods", ApiError(403, "Forbidden", text))
    await world.reconcile()
    assert world.reason("Accepted") == "False/CreationRefused"
    assert text in world.message("Accepted")
    assert "an executor's pod" in world.message("Accepted")
    assert world.api.named("pods") == world.configs() == []
