"""Spark's settings for a job, in client mode inside the driver pod.

Reasons for each setting stand beside it; the facts are Spark 4.3's own (its sources and
docs/running-on-kubernetes).
"""

import math
import re
from dataclasses import dataclass

from bagpipe.spec import JobFile, PodResources

EXECUTOR_TEMPLATE = "/etc/bagpipe/executor.yaml"
_SERVICE_ACCOUNT = "/var/run/secrets/kubernetes.io/serviceaccount"
_MEBIBYTE = 1 << 20
# Spark refuses a heap below 450 MiB; the JVM's own and the Python workers' memory comes on top.
_LEAST_HEAP_MEBIBYTES = 512
_QUANTITY = re.compile(r"^(\d+(?:\.\d+)?)(Ki|Mi|Gi|Ti|k|M|G|T|m)?$")
_FACTOR = {
    None: 1.0, "m": 1e-3, "k": 1e3, "M": 1e6, "G": 1e9, "T": 1e12,
    "Ki": 2.0**10, "Mi": 2.0**20, "Gi": 2.0**30, "Ti": 2.0**40,
}  # fmt: skip


@dataclass(frozen=True)
class DriverPod:
    """The pod that the driver runs in."""

    name: str
    namespace: str
    address: str


def quantity(text: str) -> float:
    """A Kubernetes quantity as a number (bytes or cores). Raises ValueError."""
    match = _QUANTITY.match(text)
    if match is None:
        raise ValueError(f"{text!r} is not a quantity: write for example 500m, 2, 512Mi or 1Gi")
    return float(match[1]) * _FACTOR[match[2]]


def memory_split(resources: PodResources) -> tuple[int, int]:
    """(heap, overhead) in MiB of an executor whose container may use `resources.memory`."""
    total = int(quantity(resources.memory) / _MEBIBYTE)
    heap = max(_LEAST_HEAP_MEBIBYTES, total // 2)
    return heap, max(384, total - heap)


def spark_settings(job: JobFile, pod: DriverPod) -> dict[str, str]:
    """All Spark settings of a job."""
    return _where(job, pod) | _size(job) | _endurance()


def _where(job: JobFile, pod: DriverPod) -> dict[str, str]:
    return {
        "spark.master": "k8s://https://kubernetes.default.svc",
        "spark.app.name": f"{job.namespace}/{job.name}",
        "spark.kubernetes.namespace": pod.namespace,
        "spark.kubernetes.container.image": job.images.spark,
        "spark.kubernetes.container.image.pullPolicy": "IfNotPresent",
        "spark.kubernetes.authenticate.oauthTokenFile": f"{_SERVICE_ACCOUNT}/token",
        "spark.kubernetes.authenticate.caCertFile": f"{_SERVICE_ACCOUNT}/ca.crt",
        # Makes the driver pod the executors' owner: deleting the job deletes them.
        "spark.kubernetes.driver.pod.name": pod.name,
        "spark.kubernetes.executor.podNamePrefix": f"{job.name}-{job.attempt}",
        "spark.kubernetes.executor.podTemplateFile": EXECUTOR_TEMPLATE,
        "spark.kubernetes.executor.podTemplateContainerName": "spark",
        "spark.kubernetes.executor.disableConfigMap": "true",
        # 4.3 hands executors the bind address: the pod's own, so no headless service is needed.
        "spark.driver.bindAddress": pod.address,
        "spark.driver.host": pod.address,
        "spark.ui.enabled": "false",
        "spark.ui.showConsoleProgress": "false",
        # The driver made no Services and no claims, and has no right to look for any.
        "spark.kubernetes.driver.service.deleteOnTermination": "false",
        "spark.kubernetes.driver.ownPersistentVolumeClaim": "false",
        "spark.kubernetes.driver.reusePersistentVolumeClaim": "false",
    }


def _size(job: JobFile) -> dict[str, str]:
    spark = job.spec.spark
    heap, overhead = memory_split(spark.executor.resources)
    cpu = quantity(spark.executor.resources.cpu)
    return {
        "spark.executor.instances": str(spark.executors),
        # Slots are task places, not processors: the pod requests what the user asked for.
        "spark.executor.cores": str(spark.slots),
        "spark.kubernetes.executor.request.cores": f"{math.ceil(cpu * 1000)}m",
        "spark.executor.memory": f"{heap}m",
        "spark.executor.memoryOverhead": f"{overhead}m",
        "spark.task.cpus": "1",
        # Begin with the first executor: waiting for all would make one stuck pod stop the job.
        "spark.scheduler.minRegisteredResourcesRatio": "0.0",
        "spark.kubernetes.allocation.batch.size": "100",
        "spark.kubernetes.allocation.batch.delay": "1s",
    }


def _endurance() -> dict[str, str]:
    return {
        "spark.kubernetes.resource.type": "python",
        "spark.kubernetes.executor.enablePollingWithResourceVersion": "true",
        "spark.kubernetes.executor.deleteOnTermination": "true",
        "spark.executor.maxNumFailures": "20",
        "spark.executor.failuresValidityInterval": "1h",
        "spark.excludeOnFailure.enabled": "false",
        "spark.speculation": "false",
        # A cancelled task must not leave its Python worker behind with a leased slot.
        "spark.task.reaper.enabled": "true",
        "spark.task.reaper.killTimeout": "60s",
        "spark.task.maxFailures": "4",
        "spark.python.worker.reuse": "true",
        "spark.locality.wait": "0s",
    }
