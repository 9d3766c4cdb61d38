"""kopf's part for Workloads: those of jobs go to the view, and wake their jobs."""

from dataclasses import dataclass
from typing import Any

import kopf

from bagpipe_operator.api import names
from bagpipe_operator.api.objects import Json
from bagpipe_operator.jobs.kueue.workload import GROUP, PLURAL, VERSION
from bagpipe_operator.jobs.kueue.workload_view import Workloads, WorkloadView
from bagpipe_operator.runtime.metrics import Metrics
from bagpipe_operator.runtime.queue import WorkQueue


@dataclass
class WorkloadWatch:
    """Takes what the watch of Workloads delivers."""

    workloads: Workloads
    queue: WorkQueue
    metrics: Metrics

    def event(self, event: Json) -> None:
        """A Workload of some job was listed, added, changed or deleted."""
        workload = WorkloadView.from_object(event["object"])
        self.metrics.watch_events.labels(kind="Workload").inc()
        if event["type"] == "DELETED":
            self.workloads.drop(workload)
        elif not self.workloads.put(workload):
            return
        self.queue.add(workload.job_uid)


def register_workloads(handlers: kopf.OperatorRegistry, watch: WorkloadWatch) -> None:
    """Adds the handlers to a registry."""

    @kopf.on.startup(registry=handlers)
    async def select(settings: kopf.OperatorSettings, **_: Any) -> None:
        settings.watching.label_selectors[GROUP, VERSION, PLURAL] = names.LABEL_JOB_UID

    @kopf.on.event(
        GROUP, VERSION, PLURAL, labels={names.LABEL_JOB_UID: kopf.PRESENT}, registry=handlers
    )
    async def on_workload(event: Any, **_: Any) -> None:
        watch.event(event)
