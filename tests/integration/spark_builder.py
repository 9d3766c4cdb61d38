"""Spark's own builder of executors' pods, in a JVM with a driver's environment; no cluster."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest
import yaml
from pyspark.java_gateway import launch_gateway

from bagpipe.driver.spark_context import DriverPod, spark_settings
from bagpipe_operator.jobs.pods.driver_pod import driver_pod
from bagpipe_operator.jobs.pods.job_config import read_spec
from bagpipe_operator.settings import Settings
from tests.unit.bagpipe.jobs import make_job as make_job_file
from tests.unit.operator.builders import make_job

Json = dict[str, Any]

HADOOP_USER = "user-of-a-secret"


@contextmanager
def spark_classes() -> Iterator[Any]:
    """The JVM, with the environment of a driver's container and a Secret's user of HDFS."""
    job = make_job("x").view()
    (container,) = driver_pod(job, read_spec(job), 1, Settings(), "x-1-0a")["spec"]["containers"]
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("HADOOP_USER_NAME", HADOOP_USER)
        for each in container["env"]:
            if "value" in each:
                patch.setenv(each["name"], each["value"])
        gateway = launch_gateway()  # type: ignore[no-untyped-call]
    yield gateway.jvm
    gateway.shutdown()
    gateway.proc.stdin.close()
    gateway.proc.wait(timeout=30)


def built(jvm: Any, template: Path) -> tuple[Json, Json]:
    """(pod without Spark's container, Spark's container) of Spark's KubernetesExecutorBuilder."""

    def module(name: str) -> Any:
        return jvm.java.lang.Class.forName(f"{name}$").getField("MODULE$").get(None)

    settings = spark_settings(make_job_file({}), DriverPod("x-1-driver", "lab", "10.0.0.1"), 1)
    conf = jvm.org.apache.spark.SparkConf(False)
    for name, value in settings.items():
        conf.set(name, value)
    conf.set("spark.kubernetes.executor.podTemplateFile", str(template))
    conf.set("spark.kubernetes.executor.disableConfigMap", "true")
    conf.set("spark.app.id", "app")
    none = module("scala.None")
    profile = module("org.apache.spark.resource.ResourceProfile").getOrCreateDefaultProfile(conf)
    secret_file = module("org.apache.spark.internal.config.package").AUTH_SECRET_FILE()
    described = jvm.org.apache.spark.deploy.k8s.KubernetesExecutorConf(conf, "app", "1", none, 0)
    manager = jvm.org.apache.spark.SecurityManager(conf, none, secret_file)
    manager.initializeAuth()
    client = jvm.io.fabric8.kubernetes.client.KubernetesClientBuilder().build()
    builder = jvm.org.apache.spark.scheduler.cluster.k8s.KubernetesExecutorBuilder()
    pod = builder.buildFromFeatures(described, manager, client, profile).pod()
    text = jvm.io.fabric8.kubernetes.client.utils.Serialization.asYaml
    return yaml.safe_load(text(pod.pod())), yaml.safe_load(text(pod.container()))
