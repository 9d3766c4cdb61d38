"""What Events and claims say of a pod that waits, and which pods are asked about."""

from datetime import timedelta

import pytest

from bagpipe_operator.api.objects import Json
from bagpipe_operator.jobs.troubles import pending
from tests.unit.operator.builders import START, PodBuilder, make_driver, make_executor


def event(reason: str, message: str = "", after: float = 0) -> Json:
    moment = (START + timedelta(seconds=after)).strftime("%Y-%m-%dT%H:%M:%SZ")
    return {"metadata": {}, "reason": reason, "message": message, "lastTimestamp": moment}


def on_node(pod: PodBuilder) -> PodBuilder:
    pod.node = "worker-1"
    return pod


def test_which_pods_are_asked_about() -> None:
    creating = on_node(make_driver("x").waiting("driver", "ContainerCreating"))
    assert pending.awaits_its_node(creating.view())
    assert pending.awaits_its_node(on_node(make_driver("x")).view())
    assert not pending.awaits_its_node(make_driver("x").view())
    assert not pending.awaits_its_node(on_node(make_driver("x").running()).view())
    assert not pending.awaits_its_node(on_node(make_driver("x")).deleting().view())
    assert not pending.awaits_its_node(
        on_node(make_driver("x").waiting("driver", "ErrImagePull")).view()
    )


@pytest.mark.parametrize(
    ("reason", "may_be_asked_about"),
    [("PodInitializing", True), ("ContainerCreating", True), ("CrashLoopBackOff", False)],
)
def test_a_pod_whose_status_says_what_it_waits_for_is_not_asked_about(
    reason: str, may_be_asked_about: bool
) -> None:
    pod = on_node(make_executor("x").waiting("spark", reason))
    pod.with_container("agent", {"running": {}})
    pod.with_container("stack", {"terminated": {"exitCode": 0, "reason": "Completed"}})
    assert pending.awaits_its_node(pod.view()) is may_be_asked_about


def test_a_pod_that_has_a_node_or_runs_or_goes_waits_for_no_claim() -> None:
    claims = ("recordings",)
    placed = on_node(make_driver("x"))
    for pod in (placed, make_driver("x").running(), make_driver("x").deleting()):
        pod.claims = claims
        assert not pending.awaits_a_claim(pod.view())


def test_which_pods_may_wait_for_a_claim() -> None:
    pod = make_driver("x")
    assert not pending.awaits_a_claim(pod.view())
    pod.claims = ("recordings",)
    assert pending.awaits_a_claim(pod.view())
    unbound = "0/1 nodes are available: pod has unbound immediate PersistentVolumeClaims."
    assert pending.awaits_a_claim(pod.unschedulable(unbound).view())
    assert not pending.awaits_a_claim(pod.unschedulable("Insufficient cpu").view())


@pytest.mark.parametrize(
    ("reason", "text", "reported", "lasting"),
    [
        (
            "FailedMount",
            'MountVolume.SetUp failed for volume "config" : configmap "x-1" not found',
            "ConfigMapMissing",
            True,
        ),
        (
            "FailedMount",
            'MountVolume.SetUp failed for volume "keys" : secret "keys" not found',
            "SecretMissing",
            True,
        ),
        ("FailedMount", "mount failed: exit status 32", "VolumeNotMounted", False),
        ("FailedAttachVolume", "Multi-Attach error for volume", "VolumeNotMounted", False),
        ("FailedCreatePodSandBox", "failed to set up network", "ContainerNotStarting", False),
    ],
)
def test_what_events_say(reason: str, text: str, reported: str, lasting: bool) -> None:
    events = [event("Scheduled"), event(reason, text)]
    trouble = pending.of_events(on_node(make_driver("x")).view(), events)
    assert trouble is not None
    assert (trouble.reason, trouble.lasting) == (reported, lasting)
    assert f"{text}." in trouble.message


def test_a_pull_that_failed_is_reported_before_the_pods_status_has_it() -> None:
    pod = on_node(make_executor("x").waiting("stack", "PodInitializing")).view()
    text = 'Failed to pull image "example/lane:9": not found'
    failed = event("Failed", text, after=1)
    failed["involvedObject"] = {"fieldPath": "spec.initContainers{stack}"}
    pulling, error = event("Pulling", after=1), event("Failed", "Error: ErrImagePull", after=1)
    for events in ([pulling, failed, error], [error, failed, pulling]):
        trouble = pending.of_events(pod, events)
        assert trouble is not None
        assert (trouble.reason, trouble.container) == ("StackImageUnavailable", "stack")
        assert f"{text}." in trouble.message
    # It is being tried again, or the container is not this pod's, or something else failed.
    assert pending.of_events(pod, [failed, event("Pulling", after=2)]) is None
    assert pending.of_events(pod, [pulling, error]) is None
    error["involvedObject"] = failed["involvedObject"]
    assert pending.of_events(pod, [pulling, error]) is None
    failed["involvedObject"] = {"fieldPath": "spec.containers{other}"}
    assert pending.of_events(pod, [pulling, failed]) is None
    del failed["involvedObject"]
    assert pending.of_events(pod, [pulling, failed]) is None


def test_what_was_overcome_is_not_reported() -> None:
    pod = on_node(make_driver("x")).view()
    events = [event("FailedMount", "no", after=1), event("Pulling", after=2)]
    assert pending.of_events(pod, events) is None
    assert pending.of_events(pod, []) is None
    again = [*events, event("FailedCreatePodSandBox", "no", after=3)]
    assert pending.of_events(pod, again) is not None


def test_the_moment_of_an_event_in_either_of_its_forms() -> None:
    series = {"metadata": {}, "series": {"lastObservedTime": "2026-11-20T04:00:03.000000Z"}}
    single = {"metadata": {}, "eventTime": "2026-11-20T04:00:03.000000Z"}
    bare = {"metadata": {"creationTimestamp": "2026-11-20T04:00:03Z"}}
    assert {pending.last_seen(e) for e in (series, single, bare)} == {START + timedelta(seconds=3)}


def test_an_event_of_a_moment_that_is_none_explains_nothing_and_stops_nothing() -> None:
    """Who may write Events in a namespace may write any; the API server takes the year 0."""
    pod = on_node(make_driver("x")).view()
    forged = event("FailedMount", "forged") | {"lastTimestamp": "0000-12-31T23:00:00Z"}
    found = pending.of_events(pod, [event("FailedMount", 'secret "a" not found'), forged])
    assert found is not None
    assert found.reason == "SecretMissing"
    assert pending.last_seen(forged).year == 1970


def test_what_a_claim_says() -> None:
    pod = make_driver("x").view()
    missing = pending.of_claim(pod, "tapes", None, ())
    assert missing is not None
    assert (missing.reason, missing.lasting) == ("VolumeMissing", True)
    assert pending.of_claim(pod, "tapes", {"status": {"phase": "Bound"}}, ()) is None
    waiting = pending.of_claim(
        pod, "tapes", {"status": {"phase": "Pending"}}, [event("ProvisioningFailed", "no class")]
    )
    assert waiting is not None
    assert (waiting.reason, waiting.lasting) == ("VolumePending", False)
    assert waiting.message == (
        "Pod x-1-driver waits for PersistentVolumeClaim tapes, which is Pending and not bound to a "
        "volume: no class. It starts as soon as the claim is bound."
    )
    new = pending.of_claim(pod, "tapes", {"metadata": {}}, ())
    assert new is not None
    assert new.message == (
        "Pod x-1-driver waits for PersistentVolumeClaim tapes, which is Pending and not bound to a "
        "volume: No Event states why. It starts as soon as the claim is bound."
    )
    lost = pending.of_claim(pod, "tapes", {"status": {"phase": "Lost"}}, ())
    assert lost is not None
    assert lost.lasting


QUOTA = 'pods "x-1-exec-probe" is forbidden: exceeded quota: small, requested: pods=1, used: pods=1'


@pytest.mark.parametrize(
    ("status", "text", "alone", "reported"),
    [
        (403, QUOTA, True, ("QuotaExceeded", False)),
        (403, "violates PodSecurity restricted", True, ("ExecutorsRefused", True)),
        (403, "violates PodSecurity restricted", False, ("ExecutorsRefused", False)),
        (403, "namespace lanes is being terminated", True, None),
        (400, "admission webhook does not support dry run", True, None),
        (0, "Unreachable", True, None),
        (422, "spec.containers: Invalid value", True, ("ExecutorsRefused", True)),
        (422, "namespace lanes is being terminated", True, None),
        (500, "exceeded quota: the quota's controller does not answer", True, None),
    ],
)
def test_what_a_refused_executor_means(
    status: int, text: str, alone: bool, reported: tuple[str, bool] | None
) -> None:
    trouble = pending.refused_executor("x", "lanes", status, text, alone)
    assert (trouble and (trouble.reason, trouble.lasting)) == reported


def test_executors_are_asked_about_by_nobody_else() -> None:
    assert not pending.awaits_a_claim(make_executor("x").running().view())
