"""One job after the other in a driver that stays for the next one."""

import logging
import sys
from collections.abc import Callable

from bagpipe.driver.job import INTERRUPTED_STATUS, Interruption
from bagpipe.driver.seat import Seat
from bagpipe.spec import JobFile

log = logging.getLogger(__name__)


def work_in_turn(
    seat: Seat,
    work: Callable[[JobFile], bool],
    interruption: Interruption,
    left: Callable[[], None] = lambda: None,
) -> None:
    """Work on the jobs that sit down, until none comes in time or one of them was the last.

    `work` says whether the driver may stay: whether nothing of the job is left that could reach
    the next one. After what it raises, the driver takes no other job. `left` is called when the
    seat is free for another job. SIGTERM ends the wait, and so does one that came while a job was
    being ended. Raises SystemExit where it came when another job had just sat down.
    """
    while (job := seat.taken()) is not None:
        interruption.keeper = interruption.waiting = None
        if interruption.came:
            log.info("SIGTERM: job %s, which has just come, is not begun", job.name)
            sys.exit(INTERRUPTED_STATUS)
        stays = False
        try:
            stays = work(job)
        finally:
            # From here on SIGTERM raises nothing: the job is over, and its account stands.
            interruption.waiting = seat.close
            if interruption.came:
                seat.close()
            seat.leave(stays)
        if stays and not interruption.came:
            left()
