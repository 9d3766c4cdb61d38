"""Executors that were ended from outside: reported while that is new, also without their pod."""

from datetime import timedelta

import pytest

from bagpipe_operator.jobs.driver.ending import ending_of, lost_driver
from bagpipe_operator.jobs.troubles.casualties import casualties
from bagpipe_operator.jobs.troubles.diagnose import troubles
from bagpipe_operator.jobs.view import View
from tests.unit.operator.builders import (
    START,
    PodBuilder,
    account,
    make_driver,
    make_executor,
    make_job,
)
from tests.unit.operator.world import World

EVICTION = ("EvictionByEvictionAPI", "Eviction API: evicting")
TAINT = ("DeletionByTaintManager", "Taint manager: deleting due to NoExecute taint")


def killed(container: str, after: float = 0) -> PodBuilder:
    last = {"exitCode": 137, "reason": "OOMKilled", "finishedAt": START.isoformat()}
    state = {"waiting": {"reason": "CrashLoopBackOff"}} if after else {"running": {}}
    pod = make_executor("x").running()
    return pod.with_container(container, state, lastState={"terminated": last})


@pytest.mark.parametrize(
    ("container", "advice"),
    [
        ("stack", "Raise spec.stack.resources.limits.memory."),
        ("spark", "Raise spec.spark.executor.resources.memory."),
        ("agent", "Its size is Bagpipe's own: please report it."),
    ],
)
def test_each_container_s_lack_of_memory(container: str, advice: str) -> None:
    (trouble,) = casualties([killed(container).view()], [], START)
    assert (trouble.reason, trouble.container, trouble.lasting) == (
        "ExecutorOutOfMemory",
        container,
        False,
    )
    assert trouble.message == (
        f"Container {container} in pod x-1-exec-1 was ended for lack of memory. {advice}"
    )


@pytest.mark.parametrize(("seconds", "reported"), [(-5, 1), (59, 1), (60, 0), (61, 0)])
def test_it_is_reported_for_a_minute(seconds: float, reported: int) -> None:
    pod = killed("stack").view()
    now = START + timedelta(seconds=seconds)
    assert len(casualties([pod], [], now)) == len(casualties([], [pod], now)) == reported


def test_a_lack_of_memory_whose_moment_is_not_known_is_news() -> None:
    pod = make_executor("x").running()
    pod.with_container("stack", {"terminated": {"exitCode": 137, "reason": "OOMKilled"}})
    (trouble,) = casualties([pod.view()], [], START)
    assert trouble.reason == "ExecutorOutOfMemory"


def test_an_executor_s_container_that_ended_otherwise_lacked_no_memory() -> None:
    last = {"exitCode": 1, "reason": "Error", "finishedAt": START.isoformat()}
    pod = make_executor("x").running()
    pod.with_container("stack", {"running": {}}, lastState={"terminated": last})
    assert casualties([pod.view()], [], START) == []


def test_a_driver_s_end_is_not_reported_as_an_executor_s() -> None:
    """The job's own conditions report its end."""
    short = make_driver("x").ended(137, reason="OOMKilled").view()
    taken = make_driver("x").running().disrupted(*EVICTION).deleting().view()
    assert casualties([short], [short, taken], START) == []


def test_a_container_that_is_ended_for_it_again_and_again_is_lasting() -> None:
    pod = killed("stack", after=1).view()
    (trouble,) = troubles([pod], START + timedelta(hours=1))
    assert (trouble.reason, trouble.lasting) == ("ExecutorOutOfMemory", True)


def test_a_pod_that_spark_has_deleted_still_shows_why() -> None:
    view = View()
    view.put_job(make_job("x").view())
    pod = killed("spark").deleting().view()
    view.put_pod(pod)
    view.drop_pod(pod)
    (trouble,) = troubles(view.pods("uid-of-x"), START, view.gone_pods("uid-of-x"))
    assert trouble.reason == "ExecutorOutOfMemory"


@pytest.mark.parametrize("executors", [9, 10, 300])
@pytest.mark.parametrize("backoff_limit", [0, 3])
async def test_the_account_of_a_driver_outlasts_the_executors_that_go_with_it(
    executors: int, backoff_limit: int
) -> None:
    """Ten executors pushed it out: a job that was committed was run again, or had failed."""
    world = World(make_job("x").with_spec("backoffLimit", backoff_limit))
    await world.reconcile()
    world.drivers.says = account()
    others = [make_executor("x", number).running() for number in range(1, executors + 1)]
    world.deliver(make_driver("x").running(), *others)
    await world.reconcile()
    done = account("Complete", verdict="Passed", cases={"planned": 4, "passed": 4})
    driver = make_driver("x").ended(0, done)
    world.deliver(driver)
    for pod in (driver, *others):  # all before the next visit
        world.api.objects.pop(("pods", pod.name))
        world.view.drop_pod(pod.view())
    for _ in range(3):
        await world.reconcile(after=11)
    status = world.status()
    assert (status["phase"], status["verdict"], status["attempt"]) == ("Complete", "Passed", 1)


def test_of_drivers_that_went_the_last_ones_are_remembered_one_for_each_attempt() -> None:
    """Copies of a driver, which anybody with rights in the namespace may make, push none out."""
    view = View()
    view.put_job(make_job("x").view())

    def goes(pod: PodBuilder) -> None:
        view.put_pod(pod.view())
        view.drop_pod(pod.view())

    for attempt in (*range(1, 13), 12):
        goes(make_driver("x", attempt).ended(1, f"final message of {attempt}"))
    for number in range(20):
        copy = make_driver("x", 12)
        copy.name = f"copy-{number}"
        goes(copy)
    gone = [pod.name for pod in view.gone_pods("uid-of-x")]
    assert gone[:10] == [f"x-{attempt}-driver" for attempt in range(3, 13)]
    assert gone[10:] == [f"copy-{number}" for number in range(10, 20)]


def test_only_the_last_pods_are_remembered_and_of_unfinished_jobs() -> None:
    view = View()
    job = make_job("x")
    view.put_job(job.view())
    for number in range(15):
        pod = make_executor("x", number).view()
        view.put_pod(pod)
        view.drop_pod(pod)
    assert [p.name for p in view.gone_pods("uid-of-x")] == [f"x-1-exec-{n}" for n in range(5, 15)]
    view.put_job(job.with_status(conditions=[{"type": "Complete", "status": "True"}]).view())
    assert view.gone_pods("uid-of-x") == ()


def test_an_eviction_through_the_api() -> None:
    pod = make_executor("x").running().disrupted(*EVICTION).deleting().view()
    (trouble,) = troubles([pod], START)
    assert (trouble.reason, trouble.lasting) == ("ExecutorEvicted", False)
    assert trouble.message == (
        "Pod x-1-exec-1 was evicted through the eviction API, as `kubectl drain` does: "
        "Eviction API: evicting. Spark replaces it."
    )


@pytest.mark.parametrize(("seconds", "reported"), [(59, 1), (60, 0), (61, 0)])
def test_an_eviction_is_reported_for_a_minute(seconds: float, reported: int) -> None:
    pod = make_executor("x").running().disrupted(*EVICTION).deleting().view()
    now = START + timedelta(seconds=seconds)
    assert len(casualties([pod], [], now)) == len(casualties([], [pod], now)) == reported


def test_an_executor_that_the_kubelet_evicted() -> None:
    pod = make_executor("x").evicted("The node was low on resource: memory.").view()
    (trouble,) = casualties([pod], [], START)
    assert (trouble.reason, trouble.lasting) == ("ExecutorEvicted", False)
    assert trouble.message == (
        "Pod x-1-exec-1 was evicted: The node was low on resource: memory. Spark replaces it."
    )


def test_an_executor_that_ended_for_another_reason_was_not_evicted() -> None:
    pod = make_executor("x").ended(1)
    pod.status |= {"reason": "NodeShutdown"}
    assert casualties([pod.view()], [], START) == []


@pytest.mark.parametrize(
    ("disruption", "reason", "reported"),
    [
        (
            EVICTION,
            "DriverEvicted",
            "is being evicted through the eviction API, as `kubectl drain` does",
        ),
        (
            TAINT,
            "DriverLost",
            "is taken away (DeletionByTaintManager)",
        ),
    ],
)
def test_a_driver_in_its_grace_period_says_what_is_to_come(
    disruption: tuple[str, str], reason: str, reported: str
) -> None:
    pod = make_driver("x").running().disrupted(*disruption).deleting()
    (trouble,) = casualties([pod.view()], [], START)
    assert (trouble.reason, trouble.lasting) == (reason, False)
    assert trouble.message == (
        f"The driver's pod x-1-driver {reported}: {disruption[1]}. "
        "Another takes over once it has ended."
    )
    assert casualties([pod.ended(143).view()], [], START) == []


def test_a_pod_that_goes_with_its_node() -> None:
    pod = make_executor("x").running().disrupted(*TAINT).deleting().view()
    (trouble,) = troubles([pod], START)
    assert (trouble.reason, trouble.lasting) == ("NodeLost", False)


@pytest.mark.parametrize("pod", [make_executor("x"), make_driver("x")])
def test_a_node_that_does_not_answer(pod: PodBuilder) -> None:
    pod.running().status |= {
        "conditions": [
            {"type": "ContainersReady", "status": "True"},
            {"type": "Ready", "status": "False"},
        ]
    }
    pod.node = "worker-2"
    (trouble,) = troubles([pod.view()], START)
    assert (trouble.reason, trouble.lasting) == ("NodeLost", False)
    assert trouble.message.startswith(f"Node worker-2 of pod {pod.name} does not answer.")
    pod.phase = "Failed"
    assert casualties([pod.view()], [], START) == []


@pytest.mark.parametrize(
    ("disruption", "reason"), [(EVICTION, "DriverEvicted"), (TAINT, "DriverLost")]
)
def test_a_driver_that_is_taken_away(disruption: tuple[str, str], reason: str) -> None:
    pod = make_driver("x").ended(143).disrupted(*disruption).deleting().view()
    ending = ending_of(pod, START)
    assert ending is not None
    assert (ending.reason, ending.lost) == (reason, True)
    gone = lost_driver("lanes", pod.name, pod)
    assert (gone.reason, gone.lost) == (reason, True)
    assert disruption[1] in gone.message


def test_a_driver_whose_jvm_was_killed_is_out_of_memory_whatever_its_account_says() -> None:
    text = '{"phase": "Failed", "reason": "DriverFailed", "message": "Py4JNetworkError"}'
    ending = ending_of(make_driver("x").ended(1, text, "OOMKilled").view(), START)
    assert ending is not None
    assert (ending.reason, ending.lost) == ("DriverOutOfMemory", True)
