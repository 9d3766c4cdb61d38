"""The executor pod as Spark itself builds it from our template, without a cluster."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
import yaml
from pyspark.java_gateway import launch_gateway

from bagpipe.driver.spark_context import DriverPod, spark_settings
from bagpipe_operator.driver_pod import driver_pod
from bagpipe_operator.executor_template import executor_template
from bagpipe_operator.job_config import read_spec
from bagpipe_operator.settings import Settings
from tests.unit.bagpipe.jobs import make_job as make_job_file
from tests.unit.operator.builders import make_job
from tests.unit.operator.test_pod_templates import POD

Json = dict[str, Any]


HADOOP_USER = "user-of-a-secret"


@pytest.fixture(scope="module")
def jvm() -> Iterator[Any]:
    """Spark's classes, in a driver's environment and with a Secret's user of HDFS."""
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

    settings = spark_settings(make_job_file({}), DriverPod("x-1-driver", "lab", "10.0.0.1"))
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


def test_spark_keeps_the_account_and_gives_secrets_to_its_own_container_alone(
    jvm: Any, tmp_path: Path
) -> None:
    job = make_job("x").with_spec("storage.secrets", ["s3-login"]).view()
    template = tmp_path / "executor.yaml"
    template.write_text(yaml.safe_dump(executor_template(job, read_spec(job), 1, Settings())))
    pod, spark = built(jvm, template)
    assert pod["spec"]["serviceAccountName"] == "bagpipe-executor"
    assert pod["spec"]["automountServiceAccountToken"] is False
    assert spark["name"] == "spark"
    assert spark["envFrom"] == [{"prefix": "BAGPIPE_SECRET_0_", "secretRef": {"name": "s3-login"}}]
    others = [*pod["spec"]["initContainers"], *pod["spec"].get("containers", [])]
    assert [c["name"] for c in others] == ["agent", "stack"]
    assert all(not c.get("envFrom") and "s3-login" not in str(c) for c in others)


def test_what_authenticates_executors_is_in_spark_s_container_alone(
    jvm: Any, tmp_path: Path
) -> None:
    job = make_job("x").view()
    template = tmp_path / "executor.yaml"
    template.write_text(yaml.safe_dump(executor_template(job, read_spec(job), 1, Settings())))
    pod, spark = built(jvm, template)
    (secret,) = [e["value"] for e in spark["env"] if e["name"] == "_SPARK_AUTH_SECRET"]
    assert len(secret) == 64
    assert secret not in str(pod)


def test_the_user_name_of_a_secret_is_not_in_executors_pods(jvm: Any, tmp_path: Path) -> None:
    job = make_job("x").view()
    template = tmp_path / "executor.yaml"
    template.write_text(yaml.safe_dump(executor_template(job, read_spec(job), 1, Settings())))
    pod, spark = built(jvm, template)
    assert {"name": "SPARK_USER", "value": "bagpipe"} in spark["env"]
    assert HADOOP_USER not in str(pod) + str(spark)


def test_spark_keeps_what_a_job_says_of_its_pods(jvm: Any, tmp_path: Path) -> None:
    job = (
        make_job("x")
        .with_spec("spark.executor.pod", POD)
        .with_spec("stack.resources", {"limits": {"nvidia.com/gpu": 1}})
        .with_spec("stack.volumeMounts", [{"name": "models", "mountPath": "/opt/models"}])
        .view()
    )
    said = executor_template(job, read_spec(job), 1, Settings())
    template = tmp_path / "executor.yaml"
    template.write_text(yaml.safe_dump(said))
    pod, spark = built(jvm, template)
    kept = pod["spec"]
    for field in (
        "nodeSelector", "tolerations", "affinity", "topologySpreadConstraints",
        "priorityClassName", "runtimeClassName", "imagePullSecrets", "securityContext",
    ):  # fmt: skip
        assert kept[field] == said["spec"][field], field
    volumes = {v["name"] for v in said["spec"]["volumes"]}
    assert volumes <= {v["name"] for v in kept["volumes"]}
    assert pod["metadata"]["labels"].items() >= said["metadata"]["labels"].items()
    assert pod["metadata"]["annotations"].items() >= said["metadata"]["annotations"].items()
    stack = next(c for c in kept["initContainers"] if c["name"] == "stack")
    expected = next(c for c in said["spec"]["initContainers"] if c["name"] == "stack")
    assert stack["resources"] == {"limits": {"nvidia.com/gpu": "1"}}
    for field in ("securityContext", "volumeMounts", "env"):
        assert stack[field] == expected[field], field
    assert spark["securityContext"]["readOnlyRootFilesystem"] is True
