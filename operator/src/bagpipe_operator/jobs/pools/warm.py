"""Which waiting driver a job may take over, and which drivers wait no longer. Pure."""

from collections import defaultdict
from collections.abc import Collection, Iterable
from dataclasses import dataclass
from datetime import datetime
from typing import Literal

# A driver that would end within this time is not offered: it might while it is handed over.
HANDOVER_SECONDS = 10.0
# A driver ends by itself when it has waited for long enough; one that does not is ended.
_LATE_SECONDS = 30.0


@dataclass(frozen=True)
class Pooling:
    """What the administrator lets drivers do after a job."""

    enabled: bool
    idle_seconds: float
    """For how long a driver waits for another job."""

    per_namespace: int
    """How many drivers may wait in one namespace at the same time."""


@dataclass(frozen=True)
class Wish:
    """What a job that names a pool needs of a driver."""

    namespace: str
    pool: str
    shape: str
    pulls: bool = False
    queue: str = ""
    brings_code: bool = False
    """Whether it has an evaluator of its own, which a worker that runs has loaded for good."""


@dataclass(frozen=True)
class WarmDriver:
    """A driver of a pool, with a job or waiting for one."""

    uid: str
    namespace: str
    pool: str
    shape: str
    """Of its pods, their account too."""

    idle_since: datetime | None = None
    """None as long as a job has it, or was promised it."""

    @property
    def waits(self) -> bool:
        """Whether it could take a job."""
        return self.idle_since is not None


ColdReason = Literal[
    "NoneWaits", "PodsDiffer", "AboutToEnd", "PoolsOff", "Queued", "ImagePulled", "OwnEvaluator",
    "DriverGone", "DriverRefused",
]  # fmt: skip


@dataclass(frozen=True)
class Cold:
    """Why a job gets pods of its own; the message is a sentence."""

    reason: ColdReason
    message: str


def chosen(
    wish: Wish, drivers: Iterable[WarmDriver], pooling: Pooling, now: datetime
) -> WarmDriver | Cold:
    """The driver that a job may take over, or why it starts cold.

    Of several the one that has waited shortest: the others come to their end.
    """
    if (cold := forbidden(wish, pooling)) is not None:
        return cold
    place = (wish.namespace, wish.pool)
    waiting = [d for d in drivers if d.waits and (d.namespace, d.pool) == place]
    if not waiting:
        return Cold("NoneWaits", f"No driver of pool {wish.pool} waits in {wish.namespace}.")
    alike = [d for d in waiting if d.shape == wish.shape]
    if not alike:
        return Cold(
            "PodsDiffer",
            f"The drivers of pool {wish.pool} that wait have other images, resources, volumes or "
            "settings than this job's pods.",
        )
    staying = [d for d in alike if _left(d, pooling, now) >= HANDOVER_SECONDS]
    if not staying:
        return Cold("AboutToEnd", f"The driver of pool {wish.pool} that waits is about to end.")
    return min(staying, key=lambda d: (-_left(d, pooling, now), d.uid))


def forbidden(wish: Wish, pooling: Pooling) -> Cold | None:
    """Why no driver of another job will do, nor this one's for another, whichever there are."""
    if not pooling.enabled:
        return Cold(
            "PoolsOff",
            "This installation keeps no drivers: ask an administrator for pools.enabled of the "
            "Helm chart.",
        )
    if wish.queue:
        return Cold(
            "Queued", f"Queue {wish.queue} admits each job's own pods, so it can't take others."
        )
    if wish.pulls:
        return Cold(
            "ImagePulled",
            "An image's pull policy is Always, and a driver that waits would not ask for it again: "
            "write IfNotPresent and a tag that does not move.",
        )
    if wish.brings_code:
        return Cold(
            "OwnEvaluator",
            "The job has an evaluator of its own, and executors that wait may have loaded another.",
        )
    return None


@dataclass(frozen=True)
class Crowd:
    """Jobs of a namespace that wait for room."""

    namespace: str
    since: datetime
    """When the namespace's jobs began to."""

    on_nodes: bool = False
    """Whether a node's room is lacking, which any namespace's pods may have; else a quota's."""


Leave = Literal["PoolsOff", "IdleTooLong", "RoomNeeded", "TooMany"]


def leaving(
    drivers: Iterable[WarmDriver], crowded: Collection[Crowd], pooling: Pooling, now: datetime
) -> list[tuple[WarmDriver, Leave]]:
    """The drivers that wait no longer, with the reason, those that waited longest first.

    No driver that has a job is among them.
    """
    found: list[tuple[WarmDriver, Leave]] = []
    kept: dict[str, int] = defaultdict(int)
    waiting = sorted(
        (d for d in drivers if d.waits), key=lambda d: (-_left(d, pooling, now), d.uid)
    )
    for driver in waiting:
        if (why := _why(driver, crowded, pooling, now)) is not None:
            found.append((driver, why))
        elif kept[driver.namespace] >= pooling.per_namespace:
            found.append((driver, "TooMany"))
        else:
            kept[driver.namespace] += 1
    return found[::-1]


def _why(
    driver: WarmDriver, crowded: Collection[Crowd], pooling: Pooling, now: datetime
) -> Leave | None:
    if not pooling.enabled:
        return "PoolsOff"
    if any(_gives_room(driver, crowd) for crowd in crowded):
        return "RoomNeeded"
    return "IdleTooLong" if _left(driver, pooling, now) <= -_LATE_SECONDS else None


def _gives_room(driver: WarmDriver, crowd: Crowd) -> bool:
    """Jobs that lack room for ever, since no node is so large, end only those that wait when the
    first of them begins to: else one tenant's mistake would end the pools of all."""
    if driver.namespace == crowd.namespace:
        return True
    return crowd.on_nodes and driver.idle_since is not None and driver.idle_since <= crowd.since


def _left(driver: WarmDriver, pooling: Pooling, now: datetime) -> float:
    """For how many seconds it still waits; negative when it should have ended."""
    since = driver.idle_since or now
    return pooling.idle_seconds - (now - since).total_seconds()
