"""What kopf delivers reaches the view and the queue; and kopf's settings are what we rely on."""

from itertools import islice
from typing import Any

import kopf
import pytest

from bagpipe_operator.jobs import watch
from bagpipe_operator.jobs.metrics import JobMetrics
from bagpipe_operator.jobs.view import View
from bagpipe_operator.jobs.watch import Watch
from bagpipe_operator.runtime.queue import WorkQueue
from tests.unit.operator.builders import make_driver, make_job


@pytest.fixture
def watcher() -> Watch:
    view, queue = View(), WorkQueue()
    return Watch(view, queue, JobMetrics(view, queue))


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


@pytest.mark.parametrize(
    ("manager", "known"),
    [("kueue.x-k8s.io/multikueue", False), ("sim.bagpipe.io/operator", True), (None, True)],
)
def test_jobs_that_somebody_else_runs_are_left_alone(
    watcher: Watch, manager: str | None, known: bool
) -> None:
    job = make_job("x") if manager is None else make_job("x").with_spec("managedBy", manager)
    watcher.job_event({"type": "ADDED", "object": job.object})
    assert (watcher.view.job("uid-of-x") is not None, len(watcher.queue)) == (known, known)


async def test_a_version_that_is_known_asks_for_nothing(watcher: Watch) -> None:
    job = make_job("x").view()
    watcher.view.put_job(job)  # as it came in answer to our own PATCH
    watcher.job_event({"type": "MODIFIED", "object": make_job("x").object})
    assert len(watcher.queue) == 0
    newer = make_job("x").object
    newer["metadata"]["resourceVersion"] = str(int(job.resource_version) + 1)
    watcher.job_event({"type": "MODIFIED", "object": newer})
    assert len(watcher.queue) == 1


async def test_a_pod_event_without_news_asks_for_nothing(watcher: Watch) -> None:
    pod = make_driver("x").running().object()
    watcher.pod_event({"type": None, "object": pod})
    assert await watcher.queue.get() == "uid-of-x"
    watcher.queue.done("uid-of-x")
    pod["metadata"] |= {"resourceVersion": "8", "annotations": {"somebody/wrote": "this"}}
    watcher.pod_event({"type": "MODIFIED", "object": pod})
    assert len(watcher.queue) == 0
    assert watcher.view.pods("uid-of-x")[0].resource_version == "8"
    pod["metadata"] |= {"resourceVersion": "9", "deletionTimestamp": "2026-11-20T04:00:00Z"}
    watcher.pod_event({"type": "MODIFIED", "object": pod})
    assert len(watcher.queue) == 1


async def test_jobs_that_have_begun_come_before_new_ones(watcher: Watch) -> None:
    for name in ("a", "b"):
        watcher.job_event({"type": "ADDED", "object": make_job(name).object})
    begun = make_job("c").with_status(driver="c-1-driver", phase="Running")
    watcher.job_event({"type": "ADDED", "object": begun.object})
    assert [await watcher.queue.get() for _ in range(3)] == ["uid-of-a", "uid-of-c", "uid-of-b"]


def test_kopf_keeps_no_copy_of_objects() -> None:
    settings = kopf.OperatorSettings()
    watch.apply(settings)
    storage: Any = settings.persistence.diffbase_storage
    body: Any = {"metadata": {}, "spec": {"source": {}}}
    assert storage.build(body=body, extra_fields=()) == {}
    assert storage.fetch(body=body) is None


def test_a_watch_without_rights_ends_no_operator_of_several_namespaces() -> None:
    """kopf ends as a whole when it gives up one call."""
    settings = kopf.OperatorSettings()
    watch.apply(settings, ("lanes", "maps"))
    pauses: Any = settings.networking.error_backoffs
    for _ in range(2):  # each call has them from the first one on
        assert list(islice(pauses, 7)) == [1, 2, 5, 10, 30, 30, 30]


@pytest.mark.parametrize("namespaces", [(), ("lanes",)])
def test_where_nothing_can_be_watched_the_operator_ends(namespaces: tuple[str, ...]) -> None:
    settings = kopf.OperatorSettings()
    watch.apply(settings, namespaces)
    assert settings.networking.error_backoffs == (1, 2, 5, 10, 30)


def test_kopf_writes_nothing_and_sees_only_labelled_pods() -> None:
    settings = kopf.OperatorSettings()
    watch.apply(settings)
    assert settings.scanning.disabled is True
    assert settings.posting.enabled is False
    assert settings.peering.standalone is True
    assert list(settings.watching.label_selectors.values()) == ["sim.bagpipe.io/job-uid"]
    assert settings.networking.request_timeout == 60
    assert settings.queueing.worker_limit is None
