"""The results of a job by its name in the cluster, beside those by URI or folder."""

from bagpipe.cli.cluster.hints import again
from bagpipe.cli.cluster.place import Place
from bagpipe.cli.cluster.state import JobState, Json
from bagpipe.cli.places import RefusedError, results_at
from bagpipe.report.stored import StoredResults


def results_of(place: Place, where: str, volumes: dict[str, str]) -> StoredResults:
    """The results at a URI, in a folder, or of `job/NAME` (or NAME, if a namespace is given).

    Raises ClusterError and RefusedError for a job without results, and StorageError where they lie
    on a claim that has no folder here.
    """
    name = place.job_in(where)
    if name is None:
        return results_at(where, volumes)
    return results_at(ended_job(place.cluster().job(name)).results, volumes)


def ended_job(job: Json) -> JobState:
    """A job that has left results. Raises RefusedError for one that has not, with what it does."""
    state = JobState.of(job)
    if not state.ended:
        done = f"{state.cases.done} of {state.cases.planned} cases are done"
        raise RefusedError(
            f"job {state.name} is {state.phase}, {done}: its results are there when it has ended:"
            f" {again(f'watch {state.name}', state.namespace)}"
        )
    if not state.results:
        raise RefusedError(
            f"job {state.name} ended without results: {state.reason}: {state.message}"
        )
    return state
