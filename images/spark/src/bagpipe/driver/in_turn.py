"""One job after the other in a driver that stays for the next one."""

from collections.abc import Callable

from bagpipe.driver.job import Interruption
from bagpipe.driver.seat import Seat
from bagpipe.spec import JobFile


def work_in_turn(seat: Seat, work: Callable[[JobFile], bool], interruption: Interruption) -> None:
    """Work on the jobs that sit down, until none comes in time or one of them was the last.

    `work` says whether the driver may stay: whether nothing of the job is left that could reach
    the next one. After what it raises, the driver takes no other job.
    """
    while (job := seat.taken()) is not None:
        stays = False
        try:
            stays = work(job)
        finally:
            # SIGTERM would go to the keeper of a job that is over, and end nothing.
            interruption.keeper = None
            seat.leave(stays)
