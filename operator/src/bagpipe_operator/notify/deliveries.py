"""Puts the parts together: for each receiver a sender and a line."""

import time
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager
from datetime import datetime
from pathlib import Path

from prometheus_client import CollectorRegistry

from bagpipe_operator.notify.courier import Courier, Line
from bagpipe_operator.notify.metrics import NotificationMetrics
from bagpipe_operator.notify.sender import Sender
from bagpipe_operator.runtime.clock import utc_now
from bagpipe_operator.settings import Settings


@asynccontextmanager
async def deliveries(
    settings: Settings,
    registry: CollectorRegistry,
    leads: Callable[[], bool],
    woken: Callable[[str], None],
    trust_env: bool = False,
    now: Callable[[], datetime] = utc_now,
) -> AsyncIterator[Courier]:
    """A courier to the settings' receivers; its senders are closed in the end.

    `woken` is called with the UID of a job whose letter has arrived, or never will.
    """
    courier = Courier(woken)
    metrics = NotificationMetrics([each.name for each in settings.receivers], registry)
    senders = []
    for each in settings.receivers:
        keys = Path(settings.notification_keys) / each.name / "key"
        sender = Sender(each, keys, now, trust_env=trust_env)
        senders.append(sender)
        courier.add(Line(each.name, sender, metrics, courier.ended, leads, time.monotonic))
    try:
        yield courier
    finally:
        for sender in senders:
            await sender.close()
