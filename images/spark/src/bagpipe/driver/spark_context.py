"""Spark's settings for a job, in client mode inside the driver pod.

Reasons for each setting stand beside it; the facts are Spark 4.3's own (its sources and
docs/running-on-kubernetes).
"""

import math
from dataclasses import dataclass

from bagpipe.quantities import heap_mebibytes, memory_bytes, quantity
from bagpipe.run.attempts import QUARANTINE_ATTEMPT
from bagpipe.spec import JobFile, PodResources, Spark
from bagpipe.texts import duration_seconds

EXECUTOR_TEMPLATE = "/etc/bagpipe/executor.yaml"
_SERVICE_ACCOUNT = "/var/run/secrets/kubernetes.io/serviceaccount"
_MEBIBYTE = 1 << 20
# Cases run in Python and in the stack: a JVM that hands them on has ended before its second
# compiler earns what that costs, 40 % of a start (docs/performance.md).
QUICK_JVM = "-XX:TieredStopAtLevel=1"
# So many cases were measured; a job of more may earn it.
_FEW_CASES = 3_000
# Made with the image (images/spark/class_archive.py). A JVM that can't use the archive that it
# is given uses not even Java's own, so only one that can is given it.
CLASS_ARCHIVE = "/opt/bagpipe/spark.jsa"
# Above it a JVM's references are longer than those in an archive.
_ARCHIVED_HEAP_MEBIBYTES = 32 << 10
# A case that is quicker than that is not worth a copy, however slow it is beside the others.
LEAST_STRAGGLER_SECONDS = 60
# An executor without a case is kept for so long: the case that waits next saves a start of 20 s,
# and the place is another job's soon.
IDLE_SECONDS = 15
# As long as cluster autoscalers wait for a pod; who drains a node by hand waits as long as well.
_MOST_GRACE_SECONDS = 600
# Around the case itself: its recording is kept, its stack ended.
_GRACE_AROUND_SECONDS = 60


@dataclass(frozen=True)
class DriverPod:
    """The pod that the driver runs in."""

    name: str
    namespace: str
    address: str
    # Whether its image, which executors have too, has CLASS_ARCHIVE.
    has_archive: bool = False


def memory_split(resources: PodResources) -> tuple[int, int]:
    """(heap, overhead) in MiB of an executor whose container may use `resources.memory`."""
    heap = heap_mebibytes(resources.memory)
    return heap, max(384, memory_bytes(resources.memory) // _MEBIBYTE - heap)


# Of so many earlier jobs a Spark that stays remembers each task: by default of a thousand, for
# which a driver's memory was not asked.
_REMEMBERED = {"spark.ui.retainedJobs": "2", "spark.ui.retainedStages": "2"}


def spark_settings(job: JobFile, pod: DriverPod, cases: int, stays: bool = False) -> dict[str, str]:
    """All Spark settings of a job that has so many cases to run.

    A Spark that `stays` for another job is started alike, whatever the number of the cases.
    """
    if stays:
        return _settings_for(job, pod, min(cases, _FEW_CASES)) | _REMEMBERED
    return _settings_for(job, pod, cases)


def _settings_for(job: JobFile, pod: DriverPod, cases: int) -> dict[str, str]:
    settings = _where(job, pod) | _size(job) | _width(job.spec.spark, cases)
    settings |= _endurance() | _leaving(job) | _speculation(job)
    own = settings["spark.driver.extraJavaOptions"].split()
    quick = [QUICK_JVM] if cases <= _FEW_CASES else []
    archived = [f"-XX:SharedArchiveFile={CLASS_ARCHIVE}"] if pod.has_archive else []
    heap, _ = memory_split(job.spec.spark.executor.resources)
    fits = archived if heap < _ARCHIVED_HEAP_MEBIBYTES else []
    options = {"driver": [*own, *archived, *quick], "executor": [*fits, *quick]}
    return settings | {
        f"spark.{side}.extraJavaOptions": " ".join(words)
        for side, words in options.items()
        if words
    }


def local_settings(job: JobFile, slots: int) -> dict[str, str]:
    """All Spark settings of a job whose cases run in this machine's own processes."""
    endurance = _endurance()
    failures = endurance.pop("spark.task.maxFailures")
    endurance["spark.driver.extraJavaOptions"] += f" {QUICK_JVM}"
    return {
        # Local Spark takes its number of failures from here alone.
        "spark.master": f"local[{slots}, {failures}]",
        "spark.app.name": f"{job.namespace}/{job.name}",
        "spark.driver.bindAddress": "127.0.0.1",
        "spark.driver.host": "127.0.0.1",
        "spark.ui.enabled": "false",
        "spark.ui.showConsoleProgress": "false",
    } | {key: value for key, value in endurance.items() if "kubernetes" not in key}


def _where(job: JobFile, pod: DriverPod) -> dict[str, str]:
    return {
        "spark.master": "k8s://https://kubernetes.default.svc",
        "spark.app.name": f"{job.namespace}/{job.name}",
        "spark.kubernetes.namespace": pod.namespace,
        "spark.kubernetes.container.image": job.images.spark,
        "spark.kubernetes.container.image.pullPolicy": job.images.pull_policy,
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
        # The stack shares the executor's network and must not speak to the driver as Spark does,
        # whose messages are code. The secret is in the environment of Spark's containers alone.
        "spark.authenticate": "true",
        "spark.network.crypto.enabled": "true",
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


def _width(spark: Spark, cases: int) -> dict[str, str]:
    """How many executors there are, or between which bounds Spark has them come and go."""
    if not spark.is_elastic:
        return {"spark.executor.instances": str(spark.most_executors)}
    return {
        "spark.dynamicAllocation.enabled": "true",
        "spark.dynamicAllocation.minExecutors": str(spark.executors_for(0)),
        "spark.dynamicAllocation.maxExecutors": str(spark.most_executors),
        # All cases are there from the beginning; else Spark asks for 1, 2, 4, ... once a second.
        "spark.dynamicAllocation.initialExecutors": str(spark.executors_for(cases)),
        "spark.dynamicAllocation.executorIdleTimeout": f"{IDLE_SECONDS}s",
        # Spark wants a shuffle service, or this. Nothing is shuffled, so it keeps no executor.
        "spark.dynamicAllocation.shuffleTracking.enabled": "true",
    }


def _endurance() -> dict[str, str]:
    return {
        "spark.kubernetes.resource.type": "python",
        "spark.kubernetes.executor.enablePollingWithResourceVersion": "true",
        "spark.kubernetes.executor.deleteOnTermination": "true",
        # Past this Spark ends its own process and the job with it, and a pod that quota refuses
        # counts too. What bounds failures is the quarantine of each case, and the operator
        # reports executors that don't come; so Spark has no limit (the largest integer).
        "spark.executor.maxNumFailures": str((1 << 31) - 1),
        # Spark keeps the time of each failure for so long.
        "spark.executor.failuresValidityInterval": "1h",
        # Without it a JVM that has lost a thread for lack of heap hangs instead of being replaced.
        "spark.driver.extraJavaOptions": "-XX:+ExitOnOutOfMemoryError",
        "spark.excludeOnFailure.enabled": "false",
        # An executor on a node that was cut off is missed after a minute, not after two.
        "spark.network.timeout": "60s",
        "spark.executor.heartbeatInterval": "10s",
        # A cancelled task must not leave its Python worker behind with a leased slot.
        "spark.task.reaper.enabled": "true",
        "spark.task.reaper.killTimeout": "60s",
        # Above the driver's own limit, which gives such a case a row instead of ending the job.
        "spark.task.maxFailures": str(QUARANTINE_ATTEMPT + 8),
        "spark.python.worker.reuse": "true",
        # Over TCP each task waits some 20 ms for its Python worker, and a stack that shares the
        # pod's network could try to speak to it; the socket's file is in Spark's own /tmp.
        "spark.python.unix.domain.socket.enabled": "true",
        "spark.locality.wait": "0s",
    }


def _leaving(job: JobFile) -> dict[str, str]:
    """An executor that must go, by Spark or by SIGTERM, first ends the cases that it runs.

    Spark gives it no further one. A case that takes longer than the grace period is run elsewhere,
    and Spark does not call that the case's fault.
    """
    longest = math.ceil(duration_seconds(job.spec.playback.case_timeout))
    grace = min(_MOST_GRACE_SECONDS, longest + _GRACE_AROUND_SECONDS)
    return {
        "spark.decommission.enabled": "true",
        # What a kubelet sends, whatever the reason; for its own choice Spark needs a script.
        "spark.executor.decommission.signal": "TERM",
        "spark.kubernetes.decommission.script": "/bin/true",
        "spark.kubernetes.executor.terminationGracePeriodSeconds": f"{grace}s",
    }


def _speculation(job: JobFile) -> dict[str, str]:
    """A case that hangs on one executor is tried on another; the first row counts.

    The loser's recording is removed with all that the manifest does not name.
    """
    half_of_the_timeout = duration_seconds(job.spec.playback.case_timeout) / 2
    return {
        "spark.speculation": "true",
        # Half, so that all slots of one of two executors may hang and the others still show it.
        "spark.speculation.quantile": "0.5",
        "spark.speculation.multiplier": "3",
        "spark.speculation.minTaskRuntime": f"{LEAST_STRAGGLER_SECONDS}s",
        "spark.speculation.interval": "1s",
        # Spark compares the rows that tasks have read, ours read none: it would wait twice as long.
        "spark.speculation.efficiency.enabled": "false",
        # Where a job has no more cases than an executor has slots, too few end to compare with.
        "spark.speculation.task.duration.threshold": (
            f"{max(LEAST_STRAGGLER_SECONDS, math.ceil(half_of_the_timeout))}s"
        ),
    }
