"""The SimulationJob of one run, and what it means when the API server does not take it."""

from datetime import datetime

from bagpipe_operator.api import conditions, names, reasons
from bagpipe_operator.api.objects import Json
from bagpipe_operator.api.readings import mapping
from bagpipe_operator.cluster.client import ApiError
from bagpipe_operator.schedules.status import Refused
from bagpipe_operator.schedules.view import ScheduleView, job_name


def job_manifest(schedule: ScheduleView, run: datetime) -> Json:
    """The job as spec.jobTemplate wants it, with the schedule's own label and annotation."""
    template = mapping(schedule.spec.get("jobTemplate"))
    meta = mapping(template.get("metadata"))
    return {
        "apiVersion": names.API_VERSION,
        "kind": names.KIND,
        "metadata": {
            "name": job_name(schedule.name, run),
            "namespace": schedule.namespace,
            "labels": {**mapping(meta.get("labels")), names.LABEL_SCHEDULE: schedule.name},
            "annotations": {
                **mapping(meta.get("annotations")),
                names.ANNOTATION_SCHEDULED_AT: conditions.timestamp(run),
            },
            "ownerReferences": [
                names.owner_reference(schedule.name, schedule.uid, names.SCHEDULE_KIND)
            ],
        },
        "spec": mapping(template.get("spec")),
    }


def refusal_of(error: ApiError, name: str) -> Refused | None:
    """The refusal that an error means, or None for a fault that may pass by itself."""
    if error.namespace_ends:
        return None
    if error.quota_is_full:
        return Refused(reasons.QUOTA_EXCEEDED, f"the namespace's quota is full: {error.message}")
    if error.timed_out:
        return Refused(
            reasons.CREATION_REFUSED,
            f"the API server gives no answer in time about the job {name}, as where an admission "
            f"webhook hangs: {error.message}",
        )
    refused = error.refuses_for_good or error.admission_denies
    if refused or error.webhook_is_down:
        return Refused(
            reasons.CREATION_REFUSED, f"the API server refuses the job {name}: {error.message}"
        )
    return None


def name_taken(name: str, namespace: str) -> Refused:
    """The run's name belongs to a job that this schedule did not make."""
    return Refused(
        reasons.NAME_TAKEN,
        f"the job {name} exists in namespace {namespace} and does not belong to this schedule. "
        "Delete it, or give the schedule another name.",
    )


def too_many(schedule: str, namespace: str, most: int) -> Refused:
    """Nobody can know whether the run has a job, or what it would replace."""
    return Refused(
        reasons.CREATION_REFUSED,
        f"more than {most:,} jobs in namespace {namespace} have the label "
        f"{names.LABEL_SCHEDULE}={schedule}, and no more are looked at before a run is started: "
        "delete those that the schedule did not make.",
    )
