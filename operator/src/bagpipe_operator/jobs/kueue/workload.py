"""A job's Workload, and what it says of the job. Pure.

Kueue's own integrations do the same for the jobs that they know (its `jobframework`): a Workload
lists the pods that a job will have, Kueue reserves quota for all of them or for none, and the
job's controller gives the quota back, when Kueue wants it, once the pods are gone.
"""

import hashlib
import json
from datetime import datetime

from bagpipe.spec import SimulationJobSpec
from bagpipe_operator.api import conditions, names, readings
from bagpipe_operator.api.objects import Json
from bagpipe_operator.jobs.job_view import JobView
from bagpipe_operator.jobs.kueue import workload_view
from bagpipe_operator.jobs.kueue.workload_view import WorkloadView
from bagpipe_operator.jobs.pods.driver_pod import driver_pod
from bagpipe_operator.jobs.pods.executor_template import executor_trial
from bagpipe_operator.settings import Settings

GROUP = "kueue.x-k8s.io"
VERSION = "v1beta2"
PLURAL = "workloads"
# By Kueue's own tools a job's Workload is found by this label.
_LABEL_JOB_UID = f"{GROUP}/job-uid"
LABEL_PRIORITY_CLASS = f"{GROUP}/priority-class"

DRIVER = "driver"
EXECUTORS = "executors"

# What of a pod decides where it fits and what it takes; the rest is nobody's business.
_OF_POD = (
    "affinity", "nodeSelector", "priorityClassName", "resourceClaims", "restartPolicy",
    "runtimeClassName", "tolerations",
)  # fmt: skip
_OF_CONTAINER = ("name", "resources", "restartPolicy")
# What of its own limits makes Kueue deactivate a Workload; nobody else would queue it again.
_FOR_GOOD = "DeactivatedDueTo"
_DEACTIVATED = "Deactivated"
# Of these evictions nobody but the job's controller says that the Workload waits in line again;
# of the others Kueue does, when what it waits for is over.
_REQUEUED_AT_ONCE = frozenset({"Preempted", "NodeFailures"})


def name_of(job: JobView) -> str:
    """The Workload's name: the same for a job's whole life, and another for its namesake."""
    mark = hashlib.sha256(job.uid.encode()).hexdigest()[:10]
    return f"{names.KIND.lower()}-{job.name}-{mark}"


def made_of(job: JobView) -> str:
    """What of an entire job's spec its Workload was made of, and may be edited."""
    text = json.dumps(job.spec.get("spark"), sort_keys=True)
    return hashlib.sha256(text.encode()).hexdigest()[:16]


def manifest(
    job: JobView, spec: SimulationJobSpec, settings: Settings, priority: Json | None = None
) -> Json:
    """The Workload of an entire job; `priority` are its fields of that, if any."""
    driver = driver_pod(job, spec, 1, settings, "config")
    executor = executor_trial(job, spec, 1, settings)
    return {
        "apiVersion": f"{GROUP}/{VERSION}",
        "kind": "Workload",
        "metadata": {
            "name": name_of(job),
            "namespace": job.namespace,
            "labels": {
                "app.kubernetes.io/managed-by": "bagpipe",
                names.LABEL_JOB: job.name,
                names.LABEL_JOB_UID: job.uid,
                _LABEL_JOB_UID: job.uid,
            },
            "annotations": {workload_view.MADE_OF: made_of(job)},
            "ownerReferences": [names.owner_reference(job.name, job.uid)],
        },
        "spec": {
            "queueName": spec.queue_name,
            "podSets": [
                _pod_set(DRIVER, 1, driver["spec"]),
                _pod_set(EXECUTORS, spec.spark.most_executors, executor["spec"]),
            ],
            **(priority or {}),
        },
    }


def _pod_set(name: str, count: int, pod: Json) -> Json:
    spec = {key: pod[key] for key in _OF_POD if key in pod}
    for kind in ("initContainers", "containers"):
        if kind in pod:
            spec[kind] = [_container(each) for each in pod[kind]]
    return {"name": name, "count": count, "template": {"spec": spec}}


def _container(container: Json) -> Json:
    """What a container takes. The API server would take its limits for requests that are missing.

    Kueue would take those of a LimitRange instead, which may be less.
    """
    kept = {key: container[key] for key in _OF_CONTAINER if key in container}
    resources = readings.mapping(kept.get("resources"))
    requests = readings.mapping(resources.get("limits")) | resources.get("requests", {})
    return kept | ({"resources": resources | {"requests": requests}} if requests else {})


def waits_for(workload: WorkloadView, queue: object) -> str:
    """Why a job has no pods although nobody has suspended it."""
    where = f"The job waits in the queue {queue} of Kueue"
    if workload.deleting or workload.holds(workload_view.FINISHED):
        return f"{where} again: its Workload was ended or deleted, another follows when it is gone."
    evicted = workload.condition(workload_view.EVICTED) or {}
    reason = evicted.get("reason", "") if workload.holds(workload_view.EVICTED) else ""
    why = str(evicted.get("message", "")).rstrip(".")
    if reason.startswith(_FOR_GOOD):
        return f"{where}, which has given it up: {why}. Delete its Workload to queue it again."
    if reason == _DEACTIVATED and why:
        return f"{where}: {why}."  # the reason for which it waited before may still be there
    for type_, wanted in ((workload_view.QUOTA_RESERVED, "False"), (workload_view.EVICTED, "True")):
        found = workload.condition(type_)
        if found is not None and found["status"] == wanted and found["message"]:
            return f"{where}: {found['message'].rstrip('.')}."
    if workload.holds(workload_view.QUOTA_RESERVED):
        return f"{where}: it has its quota, and the queue's admission checks are not done."
    return f"{where}, which has not looked at it yet."


def must_be_released(workload: WorkloadView) -> bool:
    """Whether Kueue waits for the job's pods to be gone."""
    return workload.holds(workload_view.EVICTED) and workload.holds(workload_view.QUOTA_RESERVED)


def released(workload: WorkloadView, now: datetime) -> Json:
    """The patch of its status by which an evicted Workload gives its quota back."""
    evicted = workload.condition(workload_view.EVICTED) or {}
    why, message = str(evicted.get("reason") or "Evicted"), str(evicted.get("message") or "")
    changed = [
        conditions.Condition(workload_view.QUOTA_RESERVED, False, "Pending", message),
        conditions.Condition(
            workload_view.ADMITTED, False, "NoReservation", "The workload has no reservation"
        ),
        conditions.Condition(workload_view.REQUEUED, why in _REQUEUED_AT_ONCE, why, message),
        conditions.Condition(
            workload_view.PODS_READY, False, "WaitForStart", "The job's pods are gone."
        ),
    ]
    return _patch(workload, changed, now) | {"admission": None}


def ready(workload: WorkloadView, now: datetime) -> Json:
    """The patch of its status by which Kueue learns that the job's cases run."""
    running = conditions.Condition(
        workload_view.PODS_READY, True, "Started", "The job's cases run."
    )
    return _patch(workload, [running], now)


def finished(workload: WorkloadView, job: JobView, now: datetime) -> Json:
    """The patch of its status by which the Workload of an ended job gives its quota back."""
    written = job.status.get("conditions") or []
    failed = conditions.find(written, conditions.FAILED)
    end = failed if failed and failed["status"] == "True" else None
    end = end or conditions.find(written, conditions.COMPLETE) or {}
    reason = "Failed" if end is failed else "Succeeded"
    message = str(end.get("message") or "The job has ended.")
    return _patch(
        workload, [conditions.Condition(workload_view.FINISHED, True, reason, message)], now
    )


def _patch(workload: WorkloadView, changed: list[conditions.Condition], now: datetime) -> Json:
    """A status with these conditions among the others."""
    types = {each.type for each in changed}
    kept = [each for each in workload.conditions if each["type"] not in types]
    new = conditions.merged(workload.conditions, changed, workload.generation, now)
    return {"conditions": [*kept, *new]}
