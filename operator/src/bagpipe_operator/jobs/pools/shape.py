"""What of a job's pods another job must have alike to run in them. Pure.

The pods are rendered for a job without a name, so whatever is rendered counts and nothing has to be
listed here: images, resources, variables, Secrets, claims, users, places, labels of the user.
"""

import hashlib
import json
from dataclasses import dataclass, replace

from bagpipe.spec import SimulationJobSpec
from bagpipe_operator.api.objects import Json
from bagpipe_operator.jobs.job_view import JobView
from bagpipe_operator.jobs.pods.driver_pod import driver_pod
from bagpipe_operator.jobs.pods.executor_template import executor_trial
from bagpipe_operator.jobs.pods.pod_parts import plain
from bagpipe_operator.settings import Settings

_NOBODY = "nobody"


@dataclass(frozen=True)
class Shape:
    """A job's pods, without whose they are."""

    digest: str
    """64 hexadecimal digits; equal where pods of one job can be another's."""

    pulls: bool
    """Whether an image is to be asked for at each start, which a pod that runs has not done."""


def shape_of(job: JobView, spec: SimulationJobSpec, settings: Settings) -> Shape:
    """The shape of a job's driver and executors, with what Spark is started with."""
    nobody = replace(job, name=_NOBODY, uid=_NOBODY)
    driver = driver_pod(nobody, spec, 1, settings, _NOBODY)
    executor = executor_trial(nobody, spec, 1, settings)
    described = {
        "driver": driver,
        "executor": executor,
        # What of Spark's settings is not in its pods: how many executors, and their patience.
        "spark": plain(spec.spark),
        "caseTimeout": spec.playback.case_timeout,
    }
    text = json.dumps(described, sort_keys=True)
    pulls = _pulls(driver) or _pulls(executor)
    return Shape(hashlib.sha256(text.encode()).hexdigest(), pulls)


def _pulls(pod: Json) -> bool:
    containers = [*(pod["spec"].get("initContainers") or []), *pod["spec"]["containers"]]
    return any(container["imagePullPolicy"] == "Always" for container in containers)
