"""One job after the other in a driver that stays for the next one."""

import logging
from collections.abc import Callable

from bagpipe.driver.job import Interruption
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
    seat is free for another job. SIGTERM ends the wait.
    """
    while (job := _next(seat)) is not None:
        stays = False
        try:
            stays = work(job)
        finally:
            # SIGTERM would go to the keeper of a job that is over, and end nothing.
            interruption.keeper = None
            seat.leave(stays)
        if stays:
            left()


def _next(seat: Seat) -> JobFile | None:
    try:
        return seat.taken()
    except SystemExit:
        log.info("SIGTERM: this driver waits no longer")
        seat.leave(stays=False)
        return None
