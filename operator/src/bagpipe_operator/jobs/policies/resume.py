"""The job that spec.resumeFrom names: whether its results may be taken over. The rule is pure."""

from bagpipe.json_equality import same
from bagpipe.spec import SimulationJobSpec, claims
from bagpipe_operator.api.objects import Json
from bagpipe_operator.cluster.client import Api, ApiError
from bagpipe_operator.jobs.job_view import JobView

# What decides no case: where and when it runs, who is notified, and what is made of all of them.
# Any other section of the spec does, and so does one that is added to it. Of `spark`, the volumes
# that the stack mounts decide as well.
INDIFFERENT_SECTIONS = frozenset({
    "spark", "storage", "output", "comparison", "maxFailedCases", "backoffLimit", "quarantine",
    "managedBy", "suspend", "queueName", "startDeadline", "activeDeadline", "ttlAfterFinished",
    "resumeFrom", "notify",
})  # fmt: skip
_INDIFFERENT = frozenset({"resources", "imagePullPolicy"})


class CannotResumeError(ValueError):
    """The earlier job can't be gone on from; the message is a sentence for the user."""


async def find_earlier(api: Api, job: JobView, spec: SimulationJobSpec) -> Json:
    """`status.resumedFrom` of a job that names an earlier one.

    Raises CannotResumeError, and ApiError for faults that may pass.
    """
    name = str(spec.resume_from)
    try:
        earlier = JobView.from_object(await api.get_job(job.namespace, name))
    except ApiError as error:
        if not error.is_gone(name):
            raise
        raise CannotResumeError(
            f"There is no SimulationJob {name} in namespace {job.namespace}, which"
            " spec.resumeFrom names: correct the name, or leave it out to run all cases."
        ) from None
    return earlier_results(job, spec, earlier)


def earlier_results(job: JobView, spec: SimulationJobSpec, earlier: JobView) -> Json:
    """Where the earlier job's results are, and how many cases it had; raises CannotResumeError."""
    name = earlier.name
    if not earlier.finished:
        raise CannotResumeError(
            f"Job {name}, which spec.resumeFrom names, has not ended: wait until it is Complete or"
            " Failed, or delete this job."
        )
    for section in sorted({*job.spec, *earlier.spec} - INDIFFERENT_SECTIONS):
        if not same(_decisive(job, section), _decisive(earlier, section)):
            raise CannotResumeError(
                f"spec.{section} is not that of job {name}, which spec.resumeFrom names, so its"
                " results say nothing of this job's cases: write the same, or leave out"
                " spec.resumeFrom."
            )
    if not same(_mounted(job), _mounted(earlier)):
        raise CannotResumeError(
            "The volumes of spec.spark.executor.pod that spec.stack.volumeMounts names are not"
            f" those of job {name}, which spec.resumeFrom names: its cases ran with other files."
            " Write the same, or leave out spec.resumeFrom."
        )
    results = str(earlier.status.get("results") or "")
    planned = int((earlier.status.get("cases") or {}).get("planned") or 0)
    if not results or not planned:
        raise CannotResumeError(
            f"Job {name}, which spec.resumeFrom names, ended before its cases were planned: there"
            " is nothing to take over. Leave out spec.resumeFrom."
        )
    claim = results.removeprefix("pvc://").split("/", 1)[0]
    if results.startswith("pvc://") and claim not in claims(spec):
        raise CannotResumeError(
            f"The results of job {name} are on the claim {claim}, which this job does not mount:"
            " write an output.uri on that claim."
        )
    return {"job": name, "results": results, "cases": planned}


def _mounted(job: JobView) -> list[Json]:
    """The volumes of an executor's pod that the stack sees, by name."""
    executor = (job.spec.get("spark") or {}).get("executor") or {}
    volumes = (executor.get("pod") or {}).get("volumes") or []
    mounts = (job.spec.get("stack") or {}).get("volumeMounts") or []
    names = {mount["name"] for mount in mounts}
    seen = (volume for volume in volumes if volume["name"] in names)
    return sorted(seen, key=lambda volume: str(volume["name"]))


def _decisive(job: JobView, section: str) -> object:
    part = job.spec.get(section)
    if section == "evaluate" and isinstance(part, list):
        return [_without_any_heading(criterion) for criterion in part]
    if section != "stack" or not isinstance(part, dict):
        return part
    return {key: value for key, value in part.items() if key not in _INDIFFERENT}


def _without_any_heading(criterion: Json) -> Json:
    """Of a final pose without a heading the bound of its error decides nothing: jobs that a CRD of
    before has stored have one by default."""
    pose = criterion.get("finalPose")
    if not isinstance(pose, dict) or "yaw" in pose:
        return criterion
    bounds = {key: value for key, value in pose.items() if key != "maxYawError"}
    return criterion | {"finalPose": bounds}
