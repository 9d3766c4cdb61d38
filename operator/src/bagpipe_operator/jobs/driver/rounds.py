"""When a driver that can't be asked yet is looked for: the watch may have lost its end.

The deletion of a pod while a watch is being restarted is not reported. When a driver that serves
its progress is gone, its silence shows it; one that is there and stays silent, or that waits for
its node or its image, is looked for in rounds.
"""

from collections.abc import Callable

from bagpipe_operator.jobs.pod_view import PodView
from bagpipe_operator.runtime.fair_share import FairShare

LOOK_EVERY_SECONDS = 30.0


def serves(driver: PodView) -> bool:
    """Whether a driver can be asked for its progress."""
    return driver.phase == "Running" and bool(driver.ip)


class Rounds:
    """Since when each job's driver has not been looked for, with the driver's UID."""

    def __init__(self, monotonic: Callable[[], float]) -> None:
        self._monotonic = monotonic
        self._since: dict[str, tuple[str, float]] = {}
        self._share = FairShare(LOOK_EVERY_SECONDS)

    def due(self, driver: PodView, at_once: bool = False) -> bool:
        """Whether a driver is to be looked for now; the first time only if that is `at_once`."""
        known, since = self._since.get(driver.job_uid, ("", 0.0))
        if known != driver.uid:
            self.looked(driver)
            return at_once
        return self._monotonic() - since >= self._share.seconds(driver.namespace)

    def looked(self, driver: PodView) -> None:
        """The driver was looked for just now."""
        self._since[driver.job_uid] = (driver.uid, self._monotonic())
        self._share.add(driver.job_uid, driver.namespace)

    def forget(self, uid: str) -> None:
        """The job's driver answers, or is over."""
        self._since.pop(uid, None)
        self._share.remove(uid)
