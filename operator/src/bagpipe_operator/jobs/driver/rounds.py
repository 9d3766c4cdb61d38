"""When a driver that can't be asked yet is looked for: the watch may have lost its end.

The deletion of a pod while a watch is being restarted is not reported. When a driver that serves
its progress is gone, its silence shows it; one that waits for its node or its image is looked for
in rounds.
"""

from collections.abc import Callable

from bagpipe_operator.jobs.view import PodView
from bagpipe_operator.runtime.fair_share import FairShare
from bagpipe_operator.runtime.patience import Patience

LOOK_EVERY_SECONDS = 30.0


def serves(driver: PodView) -> bool:
    """Whether a driver can be asked for its progress."""
    return driver.phase == "Running" and bool(driver.ip)


class Rounds:
    """Since when each job's driver has not been looked for."""

    def __init__(self, monotonic: Callable[[], float]) -> None:
        self._monotonic = monotonic
        self._waiting = Patience()
        self._share = FairShare(LOOK_EVERY_SECONDS)

    def due(self, driver: PodView) -> bool:
        """Whether a driver that waits is to be looked for now."""
        waited = self._waiting.observe(driver.job_uid, [driver.uid], self._monotonic())
        self._share.add(driver.job_uid, driver.namespace)
        return waited[driver.uid] >= self._share.seconds(driver.namespace)

    def forget(self, uid: str) -> None:
        """The job's driver was looked for just now, or serves, or is over."""
        self._waiting.forget(uid)
        self._share.remove(uid)
