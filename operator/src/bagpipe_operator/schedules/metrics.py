"""Metrics of schedules. Those with a label per schedule are of MOST_SHOWN at most."""

from collections import Counter as Tally
from collections.abc import Callable, Iterator
from datetime import datetime
from itertools import islice

from prometheus_client import CollectorRegistry, Counter, Histogram
from prometheus_client.core import GaugeMetricFamily
from prometheus_client.registry import Collector

from bagpipe_operator.api import conditions, readings
from bagpipe_operator.runtime.clock import utc_now
from bagpipe_operator.schedules.status import STALLED
from bagpipe_operator.schedules.view import ScheduledJob, Schedules, ScheduleView

STATES = ("Scheduled", "Suspended", "Stalled")
# How the last job of a schedule ended; None: no job of it has ended.
VERDICTS = ("Passed", "Failed", "Invalid", "Errored", "None")
# A tenant may write as many schedules as its quota lets it: the others are in the sums alone.
MOST_SHOWN = 100
_WHOSE = ["job_namespace", "schedule"]


def _state(schedule: ScheduleView) -> str:
    stalled = conditions.find(schedule.status.get("conditions") or [], STALLED)
    if stalled is not None and stalled.get("status") == "True":
        return "Stalled"
    return "Suspended" if schedule.suspended else "Scheduled"


class _StateCollector(Collector):
    """Counts schedules at the moment of the scrape, and shows what their last jobs came to."""

    def __init__(self, view: Schedules, now: Callable[[], datetime]) -> None:
        self._view = view
        self._now = now

    def collect(self) -> Iterator[GaugeMetricFamily]:
        """The gauges."""
        found = list(self._view.schedules())
        states = [_state(schedule) for schedule in found]
        gauge = GaugeMetricFamily(
            "bagpipe_schedules", "SimulationSchedules by state.", labels=["state"]
        )
        for state in STATES:
            gauge.add_metric([state], states.count(state))
        yield gauge
        ended = [(schedule, self._last(schedule.uid)) for schedule in found]
        yield from _sums([each for each in ended if not each[0].suspended], self._now())
        by_name = sorted(ended, key=lambda each: (each[0].namespace, each[0].name))
        yield from _of_each(by_name)

    def _last(self, uid: str) -> ScheduledJob | None:
        jobs = reversed(self._view.jobs(uid))
        return next((job for job in jobs if job.result is not None), None)


_Ended = tuple[ScheduleView, ScheduledJob | None]


def _sums(ended: list[_Ended], now: datetime) -> Iterator[GaugeMetricFamily]:
    tally = Tally(job.result.verdict if job and job.result else "None" for _, job in ended)
    gauge = GaugeMetricFamily(
        "bagpipe_schedules_last_job",
        "SimulationSchedules that are not suspended, by how the last of their jobs that ended did; "
        "Errored: it could not be run, None: none has ended.",
        labels=["verdict"],
    )
    for verdict in VERDICTS:
        gauge.add_metric([verdict], tally[verdict])
    yield gauge
    red = [schedule for schedule, job in ended if job is not None and not job.passed]
    yield GaugeMetricFamily(
        "bagpipe_schedules_longest_red_seconds",
        "Of the schedules whose last job did not pass: the time since a job of one last passed, or "
        "since its creation, at most; 0 when all passed.",
        value=max((_since_passed(schedule, now) for schedule in red), default=0.0),
    )


def _since_passed(schedule: ScheduleView, now: datetime) -> float:
    passed = readings.moment(schedule.status.get("lastPassedTime")) or schedule.created
    return max(0.0, (now - passed).total_seconds())


def _of_each(ended: list[_Ended]) -> Iterator[GaugeMetricFamily]:
    info = GaugeMetricFamily(
        "bagpipe_schedule_job_info",
        "1; the labels name the last job of a schedule that ended, and how it did. Of the first "
        f"{MOST_SHOWN} schedules by name, as all that have this label.",
        labels=[*_WHOSE, "job_name", "verdict"],
    )
    cases = GaugeMetricFamily(
        "bagpipe_schedule_job_cases",
        "Cases of that job by state; regressed and flaky ones are of its comparison.",
        labels=[*_WHOSE, "state"],
    )
    seconds = GaugeMetricFamily(
        "bagpipe_schedule_job_seconds", "How long that job took from its start to its end.",
        labels=_WHOSE,
    )  # fmt: skip
    for schedule, job in islice((each for each in ended if each[1] is not None), MOST_SHOWN):
        if job is None or job.result is None:
            continue
        whose = [schedule.namespace, schedule.name]
        info.add_metric([*whose, job.name, job.result.verdict], 1)
        seconds.add_metric(whose, job.result.seconds)
        for state, count in job.result.cases:
            cases.add_metric([*whose, state], count)
    yield from (info, cases, seconds)


class ScheduleMetrics:
    """Counters of one operator's schedules."""

    def __init__(
        self,
        view: Schedules,
        registry: CollectorRegistry,
        now: Callable[[], datetime] = utc_now,
    ) -> None:
        registry.register(_StateCollector(view, now))
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
