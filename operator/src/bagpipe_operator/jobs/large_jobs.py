"""Large jobs have a queue of their own, and one worker.

Each call about one is as much work for the API server: thirty at once keep it from everybody else's
calls, and this replica from its Lease (issue 13).
"""

from dataclasses import dataclass, field

from bagpipe_operator.jobs.view import View
from bagpipe_operator.runtime.queue import WorkQueue


@dataclass
class LargeJobs:
    """Takes the keys of large jobs out of the other queue; tenants take turns here, too."""

    view: View
    queue: WorkQueue = field(init=False)

    def __post_init__(self) -> None:
        self.queue = WorkQueue(tenant_of=self.view.namespace_of)

    def take(self, uid: str) -> bool:
        """Whether the job is large, and so waits here; one that failed waits out its pause."""
        job = self.view.job(uid)
        if job is None or not job.large:
            self.queue.forget(uid)
            return False
        self.queue.add_if_rested(uid)
        return True
