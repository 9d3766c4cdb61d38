"""Metrics of notifications. Their one label is the receiver, of which there are few."""

from collections.abc import Iterable

from prometheus_client import CollectorRegistry, Counter, Gauge, Histogram

RESULTS = ("delivered", "failed", "dropped")
# A try's deadline is 10 s.
_BUCKETS = (0.05, 0.1, 0.25, 0.5, 1, 2.5, 5, 10)


class NotificationMetrics:
    """Counters of one operator's notifications; each receiver has its series from the start."""

    def __init__(self, receivers: Iterable[str], registry: CollectorRegistry) -> None:
        self._ended = Counter(
            "bagpipe_notifications",
            "Notifications by receiver and what became of them: delivered, failed after the last "
            "try, dropped since too many were waiting.",
            ["receiver", "result"],
            registry=registry,
        )
        self._seconds = Histogram(
            "bagpipe_notification_seconds",
            "Time of one try to notify a receiver, whatever came of it.",
            ["receiver"],
            buckets=_BUCKETS,
            registry=registry,
        )
        self._waiting = Gauge(
            "bagpipe_notifications_waiting",
            "Notifications that wait to be sent, or to be sent again.",
            ["receiver"],
            registry=registry,
        )
        for name in receivers:
            self._seconds.labels(receiver=name)
            self._waiting.labels(receiver=name)
            for result in RESULTS:
                self._ended.labels(receiver=name, result=result)

    def ended(self, receiver: str, state: str) -> None:
        """A notification was delivered, failed or dropped."""
        self._ended.labels(receiver=receiver, result=state.lower()).inc()

    def tried(self, receiver: str, seconds: float) -> None:
        """One try took so long."""
        self._seconds.labels(receiver=receiver).observe(seconds)

    def waiting(self, receiver: str, count: int) -> None:
        """So many wait now."""
        self._waiting.labels(receiver=receiver).set(count)
