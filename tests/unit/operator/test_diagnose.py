"""Why pods are stuck: one sentence for each cause, and whether only a person can mend it."""

import pytest

from bagpipe_operator.jobs.troubles.diagnose import troubles
from bagpipe_operator.jobs.troubles.trouble import Trouble
from tests.unit.operator.builders import START, PodBuilder, make_driver, make_executor

IMAGE_WORDS = [
    "ErrImagePull",
    "ImagePullBackOff",
    "ErrImageNeverPull",
    "InvalidImageName",
    "ErrRegistryUnavailable",
    "ImageInspectError",
]


def only(pod: PodBuilder) -> Trouble:
    found = troubles([pod.view()], START)
    assert len(found) == 1
    return found[0]


@pytest.mark.parametrize("word", IMAGE_WORDS)
def test_every_word_for_a_missing_image_is_understood(word: str) -> None:
    trouble = only(make_executor("x").waiting("stack", word, "no such host", "example/lane:2"))
    assert (trouble.reason, trouble.container, trouble.lasting) == (
        "StackImageUnavailable",
        "stack",
        True,
    )
    assert trouble.message == (
        f"Image example/lane:2 of container stack in pod x-1-exec-1 can't be had ({word}): no such "
        "host. Correct spec.stack.image or make it pullable, and create the job again."
    )


@pytest.mark.parametrize(
    ("pod", "container", "reason"),
    [
        (make_driver("x"), "driver", "DriverImageUnavailable"),
        (make_executor("x"), "agent", "AgentImageUnavailable"),
        (make_executor("x"), "stack", "StackImageUnavailable"),
        (make_executor("x"), "spark", "ExecutorImageUnavailable"),
    ],
)
def test_the_reason_shows_whose_image_it_is(pod: PodBuilder, container: str, reason: str) -> None:
    trouble = only(pod.waiting(container, "ErrImagePull"))
    assert trouble.reason == reason
    whose = "Correct spec.stack.image" if container == "stack" else "It is Bagpipe's own image"
    assert whose in trouble.message


def test_two_words_of_one_trouble_have_one_key() -> None:
    first = only(make_executor("x").waiting("stack", "ErrImagePull", "not found"))
    second = only(make_executor("x").waiting("stack", "ImagePullBackOff", "Back-off"))
    assert first.key == second.key == ("StackImageUnavailable", "x-1-exec-1", "stack")


def test_an_image_that_another_executor_has_is_not_lasting() -> None:
    stuck = make_executor("x", 1).waiting("stack", "ErrImagePull").view()
    fine = make_executor("x", 2).running().with_container("stack", {"running": {}}).view()
    assert [(t.pod, t.lasting) for t in troubles([stuck, fine], START)] == [("x-1-exec-1", False)]


def test_pulling_is_no_trouble() -> None:
    pod = make_executor("x").waiting("stack", "PodInitializing").waiting("agent", "")
    assert troubles([pod.view()], START) == []


@pytest.mark.parametrize("word", ["CreateContainerConfigError", "RunContainerError"])
def test_a_container_that_does_not_start(word: str) -> None:
    trouble = only(make_executor("x").waiting("stack", word, "exec format error"))
    assert trouble.reason == "ContainerNotStarting"
    assert trouble.lasting
    assert trouble.message == (
        "Container stack (image example/lane:1) in pod x-1-exec-1 does not start "
        f"({word}): exec format error."
    )


def test_a_missing_secret_names_it_and_says_what_to_do() -> None:
    text = 'secret "s3-login" not found'
    trouble = only(make_driver("x").waiting("driver", "CreateContainerConfigError", text))
    assert (trouble.reason, trouble.lasting) == ("SecretMissing", True)
    assert trouble.message.endswith(
        'does not start (CreateContainerConfigError): secret "s3-login" not found. Create Secret'
        " s3-login in namespace lanes, or correct spec.storage.secrets, and create the job again."
    )


def test_a_missing_claim() -> None:
    text = '0/1 nodes are available: persistentvolumeclaim "recordings" not found. preemption: 0/1'
    trouble = only(make_driver("x").unschedulable(text))
    assert (trouble.reason, trouble.lasting) == ("VolumeMissing", True)
    assert trouble.message == (
        "Pod x-1-driver can't start: there is no PersistentVolumeClaim recordings in namespace "
        "lanes. Create it, or correct the pvc:// URIs, and create the job again."
    )


def test_no_room_on_the_nodes_may_pass() -> None:
    trouble = only(make_executor("x").unschedulable("0/3 nodes are available: 3 Insufficient cpu"))
    assert (trouble.reason, trouble.lasting) == ("Unschedulable", False)
    assert trouble.message == (
        "Pod x-1-exec-1 has no node yet: 0/3 nodes are available: 3 Insufficient cpu. "
        "It starts as soon as a node has room."
    )


@pytest.mark.parametrize(
    ("container", "field"),
    [
        ("stack", "spec.stack.resources.limits.memory"),
        ("spark", "spec.spark.executor.resources.memory"),
    ],
)
def test_lack_of_memory_names_the_field_to_raise(container: str, field: str) -> None:
    last = {"terminated": {"exitCode": 137, "reason": "OOMKilled"}}
    pod = make_executor("x").running().with_container(container, {"running": {}}, lastState=last)
    trouble = only(pod)
    assert (trouble.reason, trouble.lasting) == ("ExecutorOutOfMemory", False)
    assert trouble.message == (
        f"Container {container} in pod x-1-exec-1 was ended for lack of memory. Raise {field}."
    )


def test_an_evicted_executor() -> None:
    trouble = only(make_executor("x").evicted("The node was low on resource: memory."))
    assert (trouble.reason, trouble.lasting) == ("ExecutorEvicted", False)


def test_lasting_troubles_come_first_and_pods_that_go_have_none() -> None:
    found = troubles(
        [
            make_executor("x", 1).unschedulable("no room").view(),
            make_executor("x", 2).waiting("stack", "ErrImagePull").view(),
            make_executor("x", 3).waiting("stack", "ErrImagePull").deleting().view(),
        ],
        START,
    )
    assert [t.reason for t in found] == ["StackImageUnavailable", "Unschedulable"]
