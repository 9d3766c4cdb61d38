"""The executors' pod template, which the driver hands to Spark. Pure.

Spark fills in its own container (image, arguments, resources), the name, the owner and the
restart policy; this module defines the rest of the pod.
"""

from bagpipe.spec import SimulationJobSpec, shared_folder, stack_images
from bagpipe_operator.api import names
from bagpipe_operator.api.objects import Json
from bagpipe_operator.jobs.job_view import JobView
from bagpipe_operator.jobs.pods import pod_parts
from bagpipe_operator.jobs.pods.volumes import (
    claim_mounts,
    claim_volumes,
    evaluator_mounts,
    evaluator_volumes,
    host_environment,
    secret_environment,
)
from bagpipe_operator.settings import Settings

AGENT = f"{names.SHARED_PATH}/bin/bagpipe-agent"

# The agent's binary, FIFOs and locks; bags are in the agent's own memory, not here.
SHARED_SIZE = "64Mi"

# Making the FIFOs takes milliseconds; two minutes allow for a node that is very busy.
READY_SECONDS = 120

_SHARED_MOUNT: Json = {"name": "shared", "mountPath": names.SHARED_PATH}


def executor_template(
    job: JobView, spec: SimulationJobSpec, attempt: int, settings: Settings
) -> Json:
    """The manifest that becomes executor.yaml."""
    pod = spec.spark.executor.pod
    return {
        "apiVersion": "v1",
        "kind": "Pod",
        "metadata": pod_parts.metadata(
            pod,
            names.labels(job.name, job.uid, names.ROLE_EXECUTOR, attempt)
            | names.queue_label(spec.queue_name),
            names.scraped(names.METRICS_PORT) if settings.scrape_annotations else {},
        ),
        "spec": {
            "restartPolicy": "Never",
            **pod_parts.placement(
                pod, names.selector(job.uid, names.ROLE_EXECUTOR), settings.architecture
            ),
            # A cloud's identity for storage hangs on it; it has no rights in the cluster.
            "serviceAccountName": settings.executor_service_account,
            # Neither Spark's executor nor the user's code has any business with the API server.
            "automountServiceAccountToken": False,
            "enableServiceLinks": False,
            "securityContext": pod_parts.groups(pod, settings.fixed_users),
            "initContainers": [
                _agent(settings),
                *(_stack(spec, n, image, settings) for n, image in enumerate(stack_images(spec))),
            ],
            "containers": [
                {
                    "name": names.CONTAINER_SPARK,
                    "image": settings.spark_image,
                    "imagePullPolicy": settings.image_pull_policy,
                    "env": host_environment(settings),
                    "envFrom": secret_environment(spec),
                    "securityContext": pod_parts.restricted(settings.fixed_users),
                    "volumeMounts": [
                        _SHARED_MOUNT,
                        *pod_parts.SPARK_SCRATCH_MOUNTS,
                        *claim_mounts(spec),
                        *evaluator_mounts(spec),
                        *pod_parts.own_mounts(spec.spark.executor.volume_mounts),
                    ],
                }
            ],
            "volumes": [
                {"name": "shared", "emptyDir": {"medium": "Memory", "sizeLimit": SHARED_SIZE}},
                *pod_parts.SCRATCH_VOLUMES,
                {"name": "bagpipe-stack-tmp", "emptyDir": {}},
                {"name": "bagpipe-stack-home", "emptyDir": {}},
                *claim_volumes(spec),
                *evaluator_volumes(spec),
                *pod_parts.own_volumes(pod),
            ],
        },
    }


def executor_trial(job: JobView, spec: SimulationJobSpec, attempt: int, settings: Settings) -> Json:
    """An executor's pod as Spark will make it, for the API server to judge and not to keep.

    Spark only logs a refusal and tries again for ever.
    """
    pod = executor_template(job, spec, attempt, settings)
    size = spec.spark.executor.resources
    pod["metadata"] |= {
        "name": f"{names.attempt_name(job.name, attempt)}-exec-trial",
        "namespace": job.namespace,
    }
    pod["spec"]["containers"][0]["resources"] = {
        "requests": {"cpu": size.cpu, "memory": size.memory},
        "limits": {"memory": size.memory},
    }
    return pod


def _agent(settings: Settings) -> Json:
    """Copies the agent's binary to where the stack's container sees it, and ends."""
    return {
        "name": names.CONTAINER_AGENT,
        "image": settings.agent_image,
        "imagePullPolicy": settings.image_pull_policy,
        "command": ["/bagpipe-agent", "install", names.SHARED_PATH],
        "resources": {
            "requests": {"cpu": "10m", "memory": "32Mi"},
            "limits": {"memory": "128Mi"},
        },
        "securityContext": pod_parts.restricted(settings.fixed_users),
        "volumeMounts": [_SHARED_MOUNT],
    }


def _stack(spec: SimulationJobSpec, number: int, image: str, settings: Settings) -> Json:
    """A user's image as a native sidecar: started before Spark, ended after it.

    Each image of the variants is a container of its own, with an agent and slots of its own.

    By default it runs as a user that no image knows, with a HOME and a /tmp of its own, so that
    any namespace takes it; a job may say that its image has to have its own user, or root.
    """
    stack = spec.stack
    shared = shared_folder(names.SHARED_PATH, number)
    port = names.METRICS_PORT + number
    return {
        "name": names.stack_container(number),
        "image": image,
        "imagePullPolicy": stack.image_pull_policy,
        "restartPolicy": "Always",
        "command": [
            AGENT, "serve", "--shared", shared, "--slots", str(spec.spark.slots),
            "--metrics", f"0.0.0.0:{port}",
        ],
        "ports": [{"name": names.metrics_port_name(number), "containerPort": port}],
        # Spark starts when this has ended, as after a startup probe, which is asked once a second.
        "lifecycle": {
            "postStart": {
                "exec": {
                    "command": [AGENT, "ready", "--shared", shared, "--wait", str(READY_SECONDS)]
                }
            }
        },
        "env": _stack_env(spec),
        "envFrom": [pod_parts.plain(source) for source in stack.env_from],
        "resources": pod_parts.plain(stack.resources),
        "securityContext": pod_parts.stack_security(stack.security_context, settings.fixed_users),
        "volumeMounts": _stack_mounts(spec),
    }  # fmt: skip


def _stack_env(spec: SimulationJobSpec) -> list[Json]:
    """What only the kubelet can fill in; plain values travel with the case."""
    stack = spec.stack
    given = [
        {"name": v.name, "valueFrom": pod_parts.plain(v.value_from)}
        for v in stack.env
        if v.value_from is not None
    ]
    if pod_parts.as_the_image_says(stack.security_context):
        return given
    # The image's own HOME belongs to another user, and no user has this number.
    own = {"HOME": pod_parts.STACK_HOME, "USER": "bagpipe"}
    taken = {variable["name"] for variable in given}
    return [{"name": k, "value": v} for k, v in own.items() if k not in taken] + given


def _stack_mounts(spec: SimulationJobSpec) -> list[Json]:
    """The agent's volume, the places to write, and the user's volumes; theirs may be at /tmp."""
    mounts = pod_parts.own_mounts(spec.stack.volume_mounts)
    taken = {mount["mountPath"] for mount in mounts}
    own = {"bagpipe-stack-tmp": "/tmp", "bagpipe-stack-home": pod_parts.STACK_HOME}  # noqa: S108
    scratch = [{"name": n, "mountPath": p} for n, p in own.items() if p not in taken]
    return [_SHARED_MOUNT, *scratch, *mounts]
