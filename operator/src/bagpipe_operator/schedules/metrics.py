"""Metrics of schedules. None has a label per schedule: those would grow without end."""

from collections.abc import Iterator

from prometheus_client import CollectorRegistry, Counter, Histogram
from prometheus_client.core import GaugeMetricFamily
from prometheus_client.registry import Collector

from bagpipe_operator.api import conditions
from bagpipe_operator.schedules.status import STALLED
from bagpipe_operator.schedules.view import Schedules, ScheduleView

STATES = ("Scheduled", "Suspended", "Stalled")


def _state(schedule: ScheduleView) -> str:
    stalled = conditions.find(schedule.status.get("conditions") or [], STALLED)
    if stalled is not None and stalled.get("status") == "True":
        return "Stalled"
    return "Suspended" if schedule.suspended else "Scheduled"


class _StateCollector(Collector):
    """Counts schedules at the moment of the scrape."""

    def __init__(self, view: Schedules) -> None:
        self._view = view

    def collect(self) -> Iterator[GaugeMetricFamily]:
        """The gauge."""
        states = [_state(schedule) for schedule in self._view.schedules()]
        gauge = GaugeMetricFamily(
            "bagpipe_schedules", "SimulationSchedules by state.", labels=["state"]
        )
        for state in STATES:
            gauge.add_metric([state], states.count(state))
        yield gauge


class ScheduleMetrics:
    """Counters of one operator's schedules."""

    def __init__(self, view: Schedules, registry: CollectorRegistry) -> None:
        registry.register(_StateCollector(view))
        self.started = Counter(
            "bagpipe_schedule_jobs_started",
            "Jobs that were created for a run of a schedule.",
            registry=registry,
        )
        self.lateness = Histogram(
            "bagpipe_schedule_start_late_seconds",
            "From the moment of a run to the creation of its job.",
            buckets=(0.5, 1, 2, 5, 10, 30, 60, 300, 3600),
            registry=registry,
        )
