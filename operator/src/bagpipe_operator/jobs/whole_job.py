"""A job with all of its spec, of which the view keeps only what decides at each visit."""

from dataclasses import replace

from bagpipe_operator.api.kept_spec import unpacked
from bagpipe_operator.cluster.client import Api, ApiError
from bagpipe_operator.jobs.job_view import JobView


async def whole(api: Api, job: JobView) -> JobView:
    """Out of memory, or from the API server if it is large.

    Raises ApiError, with status 404 where the job is gone and another has its name.
    """
    if job.packed is None:
        return job
    entire = unpacked(job.packed)
    if entire is None:
        live = JobView.from_object(await api.get_job(job.namespace, job.name))
        if live.uid != job.uid:
            raise ApiError(404, "NotFound", f"{job.namespace}/{job.name} is another job by now")
        return replace(job, spec=live.spec, marks=live.marks, packed=None)
    return replace(job, spec=entire["spec"], marks=entire["marks"], packed=None)
