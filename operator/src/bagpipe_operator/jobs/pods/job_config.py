"""The ConfigMap of an attempt: job.json for the driver, executor.yaml for Spark. Pure."""

import json

import yaml
from pydantic import ValidationError

from bagpipe.quantities import heap_mebibytes
from bagpipe.spec import SimulationJobSpec
from bagpipe.spec_faults import sentence
from bagpipe_operator.api import names
from bagpipe_operator.api.nesting import DEEPEST, is_deep
from bagpipe_operator.api.objects import Json
from bagpipe_operator.api.readings import mapping
from bagpipe_operator.jobs.job_view import JobView
from bagpipe_operator.jobs.pods.executor_template import executor_template
from bagpipe_operator.jobs.pods.pinned import none_yet, pinned_baseline, with_baseline
from bagpipe_operator.jobs.pods.volumes import claim_paths
from bagpipe_operator.settings import Settings

# The API server's limit for all of a ConfigMap's values.
LARGEST_CONFIG_BYTES = 1024 * 1024
# The fields of a job that the CRD lets anybody change once it exists.
MUTABLE = frozenset({"suspend", "activeDeadline", "startDeadline", "ttlAfterFinished", "notify"})


class UnusableSpecError(ValueError):
    """The API server let a spec pass that can't be run; the message is a sentence for its author.

    Happens for what a CRD can't express, such as the names of untyped parameters.
    """


class JobTooLargeError(ValueError):
    """The job's description does not fit in a ConfigMap; the message says by how much."""


def read_spec(job: JobView) -> SimulationJobSpec:
    """The job's spec, checked; raises UnusableSpecError."""
    if is_deep(job.spec):
        raise UnusableSpecError(
            f"spec: its lists and objects lie {DEEPEST} deep in each other or deeper, and less is"
            " read: look at stack.parameters and matrix, or keep such data in a file of the image"
        )
    try:
        spec = SimulationJobSpec.model_validate(_of_driver(job))
    except ValidationError as error:
        first = error.errors()[0]
        raise UnusableSpecError(sentence(first["loc"], first["msg"])) from None
    except ArithmeticError as error:
        raise UnusableSpecError(f"spec: a number is too large to reckon with ({error})") from None
    _check_memory(spec)
    return spec


def _check_memory(spec: SimulationJobSpec) -> None:
    """Refuses what no heap can be reckoned from: a CRD of another release may let it pass."""
    for role, part in (("driver", spec.spark.driver), ("executor", spec.spark.executor)):
        try:
            heap_mebibytes(part.resources.memory)
        except ValueError as error:
            place = ("spark", role, "resources", "memory")
            raise UnusableSpecError(sentence(place, str(error))) from None


def _lasting(spec: Json) -> Json:
    """The spec without what may be edited while the job runs, and is the operator's alone."""
    return {key: value for key, value in spec.items() if key not in MUTABLE}


def plain_spec(spec: Json) -> Json:
    """The spec with Spark's quantities as strings: a manifest may also write `cpu: 1`."""
    spark = mapping(spec.get("spark"))
    plain = {role: _plain_part(spark[role]) for role in ("driver", "executor") if role in spark}
    # Only what differs is made once more: a spec may be a megabyte.
    return spec | {"spark": spark | plain} if plain else spec


def _plain_part(part: object) -> object:
    resources = mapping(mapping(part).get("resources"))
    if not resources:
        return part
    return mapping(part) | {"resources": {key: str(value) for key, value in resources.items()}}


def _of_driver(job: JobView) -> Json:
    return with_baseline(plain_spec(job.spec), pinned_baseline(job))


def _baseline(job: JobView) -> Json:
    """What the driver is to report of spec.baseline.lastPassed."""
    pinned = pinned_baseline(job)
    if pinned is None:
        return {}
    schedule, name = pinned["schedule"], pinned["job"]
    message = "" if name else none_yet(schedule)
    return {"baseline": {"schedule": schedule, "job": name, "message": message}}


def job_config(job: JobView, spec: SimulationJobSpec, attempt: int, settings: Settings) -> Json:
    """The manifest of one attempt's ConfigMap; raises JobTooLargeError."""
    described = job_file(job, spec, attempt, settings)
    # Each takes far longer than the one before: what is too large already is not written again.
    _check_size({"job.json": json.dumps(described)})
    data = {"job.json": json.dumps(described, indent=1, sort_keys=True)}
    _check_size(data)
    # libyaml's dumper: Python's own takes 2.5 ms for a template, more than a call's time.
    data["executor.yaml"] = yaml.dump(
        executor_template(job, spec, attempt, settings), Dumper=yaml.CSafeDumper, sort_keys=False
    )
    _check_size(data)
    return {
        "apiVersion": "v1",
        "kind": "ConfigMap",
        "metadata": {
            "name": names.config_name(job.name, attempt, data),
            "namespace": job.namespace,
            "labels": names.labels(job.name, job.uid, names.ROLE_DRIVER, attempt),
            "ownerReferences": [names.owner_reference(job.name, job.uid)],
        },
        # A running job must not change under the driver's feet, and kubelets need not watch it.
        "immutable": True,
        "data": data,
    }


def _check_size(data: dict[str, str]) -> None:
    size = sum(len(text.encode()) for text in data.values())
    if size > LARGEST_CONFIG_BYTES:
        raise JobTooLargeError(
            f"The job's description takes {size} bytes or more and a ConfigMap holds "
            f"{LARGEST_CONFIG_BYTES}: move the largest of stack.parameters into the stack's image."
        )


def job_file(job: JobView, spec: SimulationJobSpec, attempt: int, settings: Settings) -> Json:
    """job.json: all that the driver knows of its job."""
    earlier = job.status.get("resumedFrom")
    resumed = {"resume": earlier} if spec.resume_from and earlier else {}
    return (
        resumed
        | _baseline(job)
        | job.marks
        | {
            "created": job.created,
            "name": job.name,
            "namespace": job.namespace,
            "uid": job.uid,
            "attempt": attempt,
            "spec": _lasting(_of_driver(job)),
            "images": {
                "spark": settings.spark_image,
                "agent": settings.agent_image,
                "pullPolicy": settings.image_pull_policy,
            },
            "volumes": claim_paths(spec),
        }
    )
