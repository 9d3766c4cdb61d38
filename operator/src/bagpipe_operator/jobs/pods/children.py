"""Creating a job's ConfigMap and driver pod, as often as asked, and what a refusal means.

Nothing here deletes: children go with their job by their ownerReference.
"""

import re

from bagpipe.spec import SimulationJobSpec, evaluator_config_maps, storage_uris
from bagpipe.storage_hosts import refused_uris
from bagpipe_operator.api import names, reasons
from bagpipe_operator.api.objects import Json
from bagpipe_operator.cluster.client import Api, ApiError, get_if_there
from bagpipe_operator.jobs.job_view import JobView
from bagpipe_operator.jobs.pod_view import PodView
from bagpipe_operator.jobs.pods.driver_pod import driver_pod
from bagpipe_operator.jobs.pods.executor_template import executor_trial
from bagpipe_operator.jobs.pods.job_config import UnusableSpecError, job_config
from bagpipe_operator.jobs.pods.refusal import Refusal
from bagpipe_operator.settings import Settings

# Of what a pod names and the API server can't look up, such as the priority class `a/b`: it answers
# 500, and would do so for ever.
_NO_NAME = "invalid resource name"
_MISSING_ACCOUNT = re.compile(r'serviceaccount "([^"]+)" not found')


async def create_children(
    api: Api,
    job: JobView,
    spec: SimulationJobSpec,
    attempt: int,
    settings: Settings,
    again: bool = False,
    shape: str = "",
) -> PodView | Refusal:
    """The attempt's driver, created now or found to exist already.

    `again`: it was refused before, so its ConfigMap is looked for first. It is looked at each time,
    since it could have been replaced by another's while there was no room for the driver.
    `shape`: of the pods, where they are to wait for another job afterwards.
    Raises UnusableSpecError, JobTooLargeError, and ApiError for faults that may pass.
    """
    check_allowed(spec, settings)
    config = job_config(job, spec, attempt, settings)
    refusal = await _try_executor(api, job, executor_trial(job, spec, attempt, settings))
    if refusal is not None:
        return refusal
    what = f"{names.driver_name(job.name, attempt)} or its ConfigMap"
    made = await _find(api, job, "configmaps", config) if again else None
    made = made or await _create_or_find(api, job, "configmaps", config, what)
    if isinstance(made, Refusal):
        return made
    pod = driver_pod(job, spec, attempt, settings, config["metadata"]["name"], shape)
    made = await _create_or_find(api, job, "pods", pod, what)
    return made if isinstance(made, Refusal) else PodView.from_object(made)


def check_allowed(spec: SimulationJobSpec, settings: Settings) -> None:
    """Refuses what this installation's administrator lets no job do."""
    if evaluator_config_maps(spec) and not settings.own_evaluators:
        raise UnusableSpecError(
            "spec.evaluate has an own evaluator, and this installation lets no job bring one: "
            "leave it out, or ask an administrator for operator.ownEvaluators of the Helm chart."
        )
    if refused := refused_uris(settings.storage_hosts, storage_uris(spec)):
        raise UnusableSpecError(
            f"{refused[0]} is on a server that this installation does not allow: use another, or "
            "ask an administrator to add it to storage.allowedHosts of the Helm chart."
        )


async def _try_executor(api: Api, job: JobView, pod: Json) -> Refusal | None:
    """Has an executor judged. A quota without room for one now may have some by then, and a pod
    of the trial's name, which comes last, is no name that Spark gives."""
    try:
        await api.try_create("pods", pod)
    except ApiError as error:
        if error.quota_is_full or error.webhook_is_not_tried or error.name_is_taken:
            return None
        return _refused(error, job, "an executor's pod")
    return None


async def _create_or_find(
    api: Api, job: JobView, resource: str, manifest: Json, what: str
) -> Json | Refusal:
    """The object, or the refusal of its creation, or that its name is another's."""
    name = manifest["metadata"]["name"]
    try:
        return await api.create(resource, manifest)
    except ApiError as error:
        if not error.name_is_taken:
            return _refused(error, job, what)
    # A former run of the operator made it and could not write so into the status.
    return _judged(job, manifest, await api.get(resource, job.namespace, name))


async def _find(api: Api, job: JobView, resource: str, manifest: Json) -> Json | Refusal | None:
    """The object if there is one of its name, or the refusal that it is another's."""
    name = manifest["metadata"]["name"]
    found = await get_if_there(api, resource, job.namespace, name)
    return None if found is None else _judged(job, manifest, found)


def _judged(job: JobView, manifest: Json, found: Json) -> Json | Refusal:
    """An object of the wanted name, if it is the wanted one."""
    name = manifest["metadata"]["name"]
    owners = found["metadata"].get("ownerReferences") or []
    if any(owner.get("uid") == job.uid for owner in owners) and _is_ours(manifest, found):
        return found
    if _goes(job, found):
        return Refusal(
            reasons.NAME_TAKEN,
            f"{manifest['kind']} {name}, which is not of this job, is being deleted in namespace "
            f"{job.namespace}. The job starts as soon as it is gone.",
            lasting=False,
        )
    return Refusal(
        reasons.NAME_TAKEN,
        f"{manifest['kind']} {name} exists in namespace {job.namespace} and does not belong to "
        f"this job. Delete it, or give the job another name.",
    )


def _goes(job: JobView, found: Json) -> bool:
    """Whether an object is on its way out: deleted, or of an earlier job of this one's name.

    That job is gone, since this one has its name; the garbage collector comes later.
    """
    meta = found["metadata"]
    earlier = (
        owner.get("uid") != job.uid
        for owner in meta.get("ownerReferences") or []
        if (owner.get("kind"), owner.get("name")) == (names.KIND, job.name)
        and str(owner.get("apiVersion")).startswith(f"{names.GROUP}/")
    )
    return bool(meta.get("deletionTimestamp")) or any(earlier)


def _is_ours(manifest: Json, found: Json) -> bool:
    """Whether a ConfigMap holds what it should: the driver makes pods of what is in it.

    Who may create ConfigMaps, and knows the job's UID, could have put another there.
    """
    return manifest["kind"] != "ConfigMap" or (
        found.get("data") == manifest["data"] and found.get("immutable") is True
    )


def _awaited(error: ApiError, what: str) -> str | None:
    """What a job waits for whose pod may be created later; None for any other error."""
    if error.quota_is_full:
        return (
            f"The namespace's quota has no room for {what}: {error.message} "
            "The job starts as soon as it has."
        )
    if error.webhook_is_down:
        return (
            f"The API server creates {what} only when a webhook answers: {error.message} "
            "The job starts as soon as it does."
        )
    if error.timed_out:
        return (
            f"The API server gives no answer in time about {what}, as where an admission webhook "
            f"hangs: {error.message} The job starts as soon as it does."
        )
    return None


def _refused(error: ApiError, job: JobView, what: str) -> Refusal:
    """The refusal that a creation's error means; raises the error where it may pass by itself."""
    refusal = _refusal_of(error, job, what)
    if refusal is None:
        raise error
    return refusal


def _refusal_of(error: ApiError, job: JobView, what: str) -> Refusal | None:
    """The refusal that an error means, or None for a fault that may pass by itself."""
    account = _MISSING_ACCOUNT.search(error.message)
    if account:
        return Refusal(
            reasons.SERVICE_ACCOUNT_MISSING,
            f"There is no ServiceAccount {account[1].rpartition('/')[2]} in namespace "
            f"{job.namespace}. Install the Helm chart bagpipe-namespace there, or add the "
            f"namespace to jobNamespaces of the chart bagpipe: either makes the account.",
        )
    if error.namespace_ends:
        return None
    if (message := _awaited(error, what)) is not None:
        reason = reasons.QUOTA_EXCEEDED if error.quota_is_full else reasons.CREATION_REFUSED
        return Refusal(reason, message, lasting=False)
    lasting = error.refuses_for_good or _NO_NAME in error.message
    if lasting or error.admission_denies:
        # A webhook may mean by another code that it is to be asked again.
        message = f"The API server refuses {what}: {error.message}"
        return Refusal(reasons.CREATION_REFUSED, message, lasting)
    return None
