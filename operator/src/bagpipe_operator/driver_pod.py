"""The Spark driver's pod. Pure: a job and the settings in, a manifest out."""

from bagpipe.spec import SimulationJobSpec
from bagpipe_operator import names
from bagpipe_operator.quantities import heap
from bagpipe_operator.settings import Settings
from bagpipe_operator.view import JobView, Json
from bagpipe_operator.volumes import claim_mounts, claim_volumes

# What the "restricted" Pod Security level asks of a container.
RESTRICTED_CONTAINER: Json = {
    "allowPrivilegeEscalation": False,
    "capabilities": {"drop": ["ALL"]},
    "runAsNonRoot": True,
    "runAsUser": names.BAGPIPE_UID,
    "runAsGroup": names.BAGPIPE_UID,
    "seccompProfile": {"type": "RuntimeDefault"},
}


def driver_pod(job: JobView, spec: SimulationJobSpec, attempt: int, settings: Settings) -> Json:
    """The manifest of one attempt's driver."""
    return {
        "apiVersion": "v1",
        "kind": "Pod",
        "metadata": {
            "name": names.driver_name(job.name, attempt),
            "namespace": job.namespace,
            "labels": names.labels(job.name, job.uid, names.ROLE_DRIVER, attempt),
            "ownerReferences": [names.owner_reference(job.name, job.uid)],
        },
        "spec": {
            "restartPolicy": "Never",
            "serviceAccountName": settings.driver_service_account,
            "enableServiceLinks": False,
            "securityContext": {
                "runAsNonRoot": True,
                "runAsUser": names.BAGPIPE_UID,
                "runAsGroup": names.BAGPIPE_UID,
                # Volumes that know groups become writable for the driver by this.
                "fsGroup": names.BAGPIPE_UID,
                "fsGroupChangePolicy": "OnRootMismatch",
                "seccompProfile": {"type": "RuntimeDefault"},
            },
            "containers": [_container(spec, settings)],
            "volumes": [
                {"name": "config", "configMap": {"name": names.attempt_name(job.name, attempt)}},
                *claim_volumes(spec),
            ],
        },
    }


def _container(spec: SimulationJobSpec, settings: Settings) -> Json:
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
            {"name": "SPARK_DRIVER_MEMORY", "value": heap(resources.memory)},
        ],
        "ports": [{"name": "progress", "containerPort": names.PROGRESS_PORT}],
        "resources": {
            "requests": {"cpu": resources.cpu, "memory": resources.memory},
            "limits": {"memory": resources.memory},
        },
        "securityContext": RESTRICTED_CONTAINER,
        "terminationMessagePath": "/dev/termination-log",
        "volumeMounts": [
            {"name": "config", "mountPath": names.CONFIG_PATH, "readOnly": True},
            *claim_mounts(spec),
        ],
    }


def _downward(name: str, field: str) -> Json:
    return {"name": name, "valueFrom": {"fieldRef": {"fieldPath": field}}}
