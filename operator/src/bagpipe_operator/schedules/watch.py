"""kopf's part for schedules: changes of them and of their jobs reach the view and the queue."""

from dataclasses import dataclass
from typing import Any

import kopf

from bagpipe_operator.api import names
from bagpipe_operator.api.objects import Json
from bagpipe_operator.runtime.metrics import Metrics
from bagpipe_operator.runtime.queue import WorkQueue
from bagpipe_operator.schedules.view import ScheduledJob, Schedules, ScheduleView


@dataclass
class ScheduleWatch:
    """Takes what the watches deliver."""

    view: Schedules
    queue: WorkQueue
    metrics: Metrics

    def schedule_event(self, event: Json) -> None:
        """A schedule was listed, added, changed or deleted."""
        schedule = ScheduleView.from_object(event["object"])
        self.metrics.watch_events.labels(kind=names.SCHEDULE_KIND).inc()
        if event["type"] == "DELETED":
            self.view.drop_schedule(schedule.uid)
            self.queue.forget(schedule.uid)
        elif not self.view.put_schedule(schedule):
            return
        self.queue.add(schedule.uid)

    def job_event(self, event: Json) -> None:
        """A job with a schedule's label was listed, added, changed or deleted."""
        job = ScheduledJob.from_object(event["object"])
        if not job.schedule_uid:
            self.view.drop_job(job)  # it may have had an owner before
            return  # a label alone makes no schedule's job
        if event["type"] == "DELETED":
            self.view.remove_job(job)
        elif not self.view.put_job(job):
            return  # the job's progress is no matter of its schedule
        if self.view.namespace_of(job.schedule_uid) == job.namespace:
            self.queue.add(job.schedule_uid)


def register(handlers: kopf.OperatorRegistry, watch: ScheduleWatch) -> None:
    """Adds the handlers of schedules to those of jobs."""

    @kopf.on.event(names.GROUP, names.VERSION, names.SCHEDULE_PLURAL, registry=handlers)
    async def on_schedule(event: Any, **_: Any) -> None:
        watch.schedule_event(event)

    @kopf.on.event(
        names.GROUP,
        names.VERSION,
        names.PLURAL,
        labels={names.LABEL_SCHEDULE: kopf.PRESENT},
        registry=handlers,
    )
    async def on_scheduled_job(event: Any, **_: Any) -> None:
        watch.job_event(event)
