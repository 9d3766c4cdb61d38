"""Jobs' whole specs, each read once more only where it was not refused before."""

from bagpipe.spec import SimulationJobSpec
from bagpipe_operator.api.conditions import LONGEST_MESSAGE
from bagpipe_operator.cluster.client import Api
from bagpipe_operator.jobs.job_view import JobView
from bagpipe_operator.jobs.pods.job_config import UnusableSpecError, read_spec
from bagpipe_operator.jobs.whole_job import whole


class Specs:
    """What is wrong with the specs of jobs that have not been ended for it yet.

    The status that says so may fail to be written, and the API server's copy of a large spec, its
    parsing and its validation take seconds that the next try would lack.
    """

    def __init__(self, api: Api) -> None:
        self._api = api
        self._refused: dict[str, tuple[int, str]] = {}  # by UID: the generation, and why

    async def read(self, job: JobView) -> tuple[JobView, SimulationJobSpec]:
        """The entire job and its spec; raises UnusableSpecError, and ApiError."""
        generation, why = self._refused.get(job.uid, (None, ""))
        if generation == job.generation:
            raise UnusableSpecError(why)
        entire = await whole(self._api, job)
        try:
            return entire, read_spec(entire)
        except UnusableSpecError as error:
            # A condition holds no more, and each refused job has one until its end is written.
            self._refused[job.uid] = (job.generation, str(error)[:LONGEST_MESSAGE])
            raise

    def forget(self, uid: str) -> None:
        """The job has ended, rests, or is gone."""
        self._refused.pop(uid, None)
