"""The Spark driver's pod. Pure: a job and the settings in, a manifest out."""

from bagpipe.quantities import heap_mebibytes
from bagpipe.spec import SimulationJobSpec
from bagpipe_operator.api import names
from bagpipe_operator.api.objects import Json
from bagpipe_operator.jobs.job_view import JobView
from bagpipe_operator.jobs.pods import pod_parts
from bagpipe_operator.jobs.pods.volumes import (
    claim_mounts,
    claim_volumes,
    host_environment,
    secret_environment,
)
from bagpipe_operator.settings import Settings

# The image's name for the user that its containers run as.
SPARK_USER = "bagpipe"


def driver_pod(
    job: JobView,
    spec: SimulationJobSpec,
    attempt: int,
    settings: Settings,
    config: str,
    shape: str = "",
) -> Json:
    """The manifest of one attempt's driver, which reads the ConfigMap of that name.

    With a shape it waits for another job of that shape when its own is Complete.
    """
    pod = spec.spark.driver.pod
    annotations = {names.ANNOTATION_SHAPE: shape} if shape else {}
    if settings.scrape_annotations:
        annotations |= names.scraped(names.PROGRESS_PORT)
    labels = names.labels(job.name, job.uid, names.ROLE_DRIVER, attempt)
    return {
        "apiVersion": "v1",
        "kind": "Pod",
        "metadata": {
            "name": names.driver_name(job.name, attempt),
            "namespace": job.namespace,
            **pod_parts.metadata(
                pod,
                labels | names.queue_label(spec.queue_name),
                annotations,
            ),
            "ownerReferences": [names.owner_reference(job.name, job.uid)],
        },
        "spec": {
            "restartPolicy": "Never",
            **pod_parts.placement(
                pod, names.selector(job.uid, names.ROLE_DRIVER), settings.architecture
            ),
            "serviceAccountName": settings.driver_service_account,
            # One container gets the token by its own mount; what others inject must not have it.
            "automountServiceAccountToken": False,
            "enableServiceLinks": False,
            "securityContext": pod_parts.groups(pod, settings.fixed_users),
            "containers": [_container(spec, settings, waits=bool(shape))],
            "volumes": [
                {"name": "config", "configMap": {"name": config}},
                pod_parts.TOKEN_VOLUME,
                *pod_parts.SCRATCH_VOLUMES,
                *claim_volumes(spec),
                *pod_parts.own_volumes(pod),
            ],
        },
    }


def _container(spec: SimulationJobSpec, settings: Settings, waits: bool) -> Json:
    resources = spec.spark.driver.resources
    return {
        "name": names.CONTAINER_DRIVER,
        "image": settings.spark_image,
        "imagePullPolicy": settings.image_pull_policy,
        "args": ["driver", "--job", f"{names.CONFIG_PATH}/job.json"],
        "env": [
            _downward("BAGPIPE_POD_IP", "status.podIP"),
            _downward("BAGPIPE_POD_NAME", "metadata.name"),
            _downward("BAGPIPE_NAMESPACE", "metadata.namespace"),
            # pyspark starts the driver's JVM with this much; its own default knows no limit.
            {"name": "SPARK_DRIVER_MEMORY", "value": f"{heap_mebibytes(resources.memory)}m"},
            # Else Spark takes the HADOOP_USER_NAME of a Secret, and writes it into executors' pods.
            {"name": "SPARK_USER", "value": SPARK_USER},
            *host_environment(settings),
            *(_waiting(settings) if waits else []),
        ],
        "envFrom": secret_environment(spec),
        "ports": [{"name": "progress", "containerPort": names.PROGRESS_PORT}],
        "resources": {
            "requests": {"cpu": resources.cpu, "memory": resources.memory},
            "limits": {"memory": resources.memory},
        },
        "securityContext": pod_parts.restricted(settings.fixed_users),
        "terminationMessagePath": "/dev/termination-log",
        "volumeMounts": [
            {"name": "config", "mountPath": names.CONFIG_PATH, "readOnly": True},
            pod_parts.TOKEN_MOUNT,
            *pod_parts.SPARK_SCRATCH_MOUNTS,
            *claim_mounts(spec),
            *pod_parts.own_mounts(spec.spark.driver.volume_mounts),
        ],
    }


def _waiting(settings: Settings) -> list[Json]:
    """By what the driver knows itself in a job's claim, and how long it waits for one."""
    return [
        _downward("BAGPIPE_POD_UID", "metadata.uid"),
        {"name": "BAGPIPE_POOL_IDLE_SECONDS", "value": f"{settings.pool_idle_seconds:g}"},
    ]


def _downward(name: str, field: str) -> Json:
    return {"name": name, "valueFrom": {"fieldRef": {"fieldPath": field}}}
