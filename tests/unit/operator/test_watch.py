"""What kopf delivers reaches the view and the queue; and kopf's settings are what we rely on."""

import kopf
import pytest

from bagpipe_operator import watch
from bagpipe_operator.metrics import Metrics
from bagpipe_operator.queue import WorkQueue
from bagpipe_operator.view import View
from bagpipe_operator.watch import Watch
from tests.unit.operator.builders import make_driver, make_job


@pytest.fixture
def watcher() -> Watch:
    view, queue = View(), WorkQueue()
    return Watch(view, queue, Metrics(view, queue))


async def test_a_job_and_its_pods_ask_for_the_same_key(watcher: Watch) -> None:
    watcher.job_event({"type": None, "object": make_job("x").object})
    watcher.pod_event({"type": "ADDED", "object": make_driver("x").object()})
    assert len(watcher.queue) == 1
    assert await watcher.queue.get() == "uid-of-x"
    assert [p.name for p in watcher.view.pods("uid-of-x")] == ["x-1-driver"]


def test_deletions_are_forgotten(watcher: Watch) -> None:
    watcher.job_event({"type": "ADDED", "object": make_job("x").object})
    watcher.pod_event({"type": "ADDED", "object": make_driver("x").object()})
    watcher.job_event({"type": "DELETED", "object": make_job("x").object})
    watcher.pod_event({"type": "DELETED", "object": make_driver("x").object()})
    assert watcher.view.job("uid-of-x") is None
    assert watcher.view.pods("uid-of-x") == ()


def test_kopf_writes_nothing_and_sees_only_labelled_pods() -> None:
    settings = kopf.OperatorSettings()
    watch.apply(settings)
    assert settings.scanning.disabled is True
    assert settings.posting.enabled is False
    assert settings.peering.standalone is True
    assert list(settings.watching.label_selectors.values()) == ["sim.bagpipe.io/job-uid"]
    assert settings.networking.request_timeout == 60
    assert settings.queueing.worker_limit is None


@pytest.mark.parametrize(
    ("environment", "expected"),
    [
        ({"KUBERNETES_SERVICE_HOST": "10.0.0.1"}, True),
        ({"KUBERNETES_SERVICE_HOST": "10.0.0.1", "KUBECONFIG": "/k"}, False),
        ({}, False),
    ],
)
def test_kubeconfig_comes_first(environment: dict[str, str], expected: bool) -> None:
    assert watch.in_cluster(environment) is expected
