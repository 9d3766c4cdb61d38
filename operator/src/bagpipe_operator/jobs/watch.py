"""kopf's part: it watches jobs and labelled pods and hands every change to the view and the queue.

Only `on.event` is used. It needs no finalizer and writes nothing into objects, so jobs can be
deleted while the operator is down; the rest of kopf (its own retries, progress annotations,
events) is switched off.
"""

import os
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import repeat
from typing import Any

import kopf

from bagpipe_operator.api import names
from bagpipe_operator.api.objects import Json
from bagpipe_operator.cluster.bounded_session import Answered, bounded_connection
from bagpipe_operator.cluster.connection import in_cluster
from bagpipe_operator.cluster.large_objects import PAGE
from bagpipe_operator.jobs.job_view import JobView
from bagpipe_operator.jobs.pod_view import PodView
from bagpipe_operator.jobs.view import View
from bagpipe_operator.runtime.metrics import Metrics
from bagpipe_operator.runtime.queue import Lane, WorkQueue

SYSTEM_ERRORS_SECONDS = (1, 2, 5, 10, 30)


@dataclass
class Watch:
    """Takes what the watches deliver."""

    view: View
    queue: WorkQueue
    metrics: Metrics

    def job_event(self, event: Json) -> None:
        """A job was listed, added, changed or deleted."""
        job = JobView.from_object(event["object"])
        self.metrics.watch_events.labels(kind=names.KIND).inc()
        if event["type"] == "DELETED":
            self.view.drop_job(job.uid)
            self.queue.forget(job.uid)
        elif job.managed_elsewhere or self._is_known(job) or not self.view.put_job(job):
            return
        starts = not job.finished and not job.deleting and not job.status.get("driver")
        self.queue.add(job.uid, Lane.START if starts else Lane.NEWS)

    def _is_known(self, job: JobView) -> bool:
        """Whether this very version was seen already: mostly as the answer to our own PATCH."""
        known = self.view.job(job.uid)
        return known is not None and known.resource_version == job.resource_version

    def pod_event(self, event: Json) -> None:
        """A pod of some job was listed, added, changed or deleted."""
        pod = PodView.from_object(event["object"])
        self.metrics.watch_events.labels(kind="Pod").inc()
        if event["type"] == "DELETED":
            self.view.drop_pod(pod)
        elif not self.view.put_pod(pod):
            return  # nothing that is decided on has changed
        uid = self.view.job_to_visit(pod)
        if uid is not None:
            self.queue.add(uid)


class NoDiffBase(kopf.DiffBaseStorage):
    """Keeps nothing of an object for a later comparison.

    Only handlers for changes need that, and there is none; kopf would copy every object deeply
    for it, with each event.
    """

    def build(self, **_: Any) -> Any:
        return {}

    def fetch(self, **_: Any) -> None:
        return None

    def store(self, **_: Any) -> None:
        """Writes nothing."""


class WithoutEnd:
    """kopf's pauses between tries of one call, of which the last one is repeated."""

    def __iter__(self) -> Iterator[float]:
        yield from SYSTEM_ERRORS_SECONDS
        yield from repeat(SYSTEM_ERRORS_SECONDS[-1])


def registry(
    watch: Watch, namespaces: Sequence[str] = (), answered: Answered = lambda _answer: None
) -> kopf.OperatorRegistry:
    """The handlers, in a registry of their own; none of `namespaces` means all.

    `answered` is called with each answer that kopf gets.
    """
    handlers = kopf.OperatorRegistry()

    # kopf asks again when a token has expired; a pod's token is renewed in its file.
    @kopf.on.login(registry=handlers, retries=5)
    async def login(**kwargs: Any) -> kopf.AiohttpSession | None:
        logged_in = (
            kopf.login_with_service_account(**kwargs)
            if in_cluster(os.environ)
            else kopf.login_with_kubeconfig(**kwargs)
        )
        return bounded_connection(logged_in, answered) if logged_in else None

    @kopf.on.startup(registry=handlers)
    async def configure(settings: kopf.OperatorSettings, **_: Any) -> None:
        apply(settings, namespaces)

    @kopf.on.event(names.GROUP, names.VERSION, names.PLURAL, registry=handlers)
    async def on_job(event: Any, **_: Any) -> None:
        watch.job_event(event)

    # The label is in the filter too: kopf merges the events of one object, whatever its labels.
    @kopf.on.event("", "v1", "pods", labels={names.LABEL_JOB_UID: kopf.PRESENT}, registry=handlers)
    async def on_pod(event: Any, **_: Any) -> None:
        watch.pod_event(event)

    return handlers


def apply(settings: kopf.OperatorSettings, namespaces: Sequence[str] = ()) -> None:
    """kopf's settings, with the reason for each."""
    # Discovery at start is enough, and needs no right to watch CRDs and namespaces.
    settings.scanning.disabled = True
    # The loop writes events of its own, after the status that they speak of.
    settings.posting.enabled = False
    # Replicas have a Lease (election.py): peering would need a CRD and rights of its own.
    settings.peering.standalone = True
    # The API server sends only the pods of jobs, not every pod of the cluster.
    settings.watching.label_selectors["", "v1", "pods"] = names.LABEL_JOB_UID
    # Thousands of jobs come in pieces, which fit the memory however large they are.
    settings.watching.chunk_size = PAGE
    # So long each object of a list is held as it was read: by default 5 s, thousands at once.
    settings.queueing.idle_timeout = 0.1
    settings.watching.connect_timeout = 10
    settings.networking.request_timeout = 60
    # A watch that is given up ends the operator. Where it has no rights in one of several
    # namespaces, that one's watch waits for some, and the others' go on.
    several = len(namespaces) > 1
    settings.networking.error_backoffs = WithoutEnd() if several else SYSTEM_ERRORS_SECONDS
    # Should kopf ever want to write, then at least under our own name.
    settings.persistence.finalizer = f"{names.GROUP}/finalizer"
    settings.persistence.progress_storage = kopf.AnnotationsProgressStorage(prefix=names.GROUP)
    settings.persistence.diffbase_storage = NoDiffBase()
