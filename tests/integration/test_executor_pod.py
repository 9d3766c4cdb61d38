"""The executor pod as Spark itself builds it from our template, without a cluster."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
import yaml

from bagpipe_operator.jobs.pods.executor_template import executor_template
from bagpipe_operator.jobs.pods.job_config import read_spec
from bagpipe_operator.settings import Settings
from tests.integration.spark_builder import HADOOP_USER, built, spark_classes
from tests.unit.operator.builders import make_job
from tests.unit.operator.test_pod_templates import POD


@pytest.fixture(scope="module")
def jvm() -> Iterator[Any]:
    """Spark's classes."""
    with spark_classes() as found:
        yield found


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


def test_spark_keeps_the_servers_that_storage_may_be_on(jvm: Any, tmp_path: Path) -> None:
    job, settings = make_job("x").view(), Settings(storage_hosts=("s3.lab", "*.example.com"))
    template = tmp_path / "executor.yaml"
    template.write_text(yaml.safe_dump(executor_template(job, read_spec(job), 1, settings)))
    _, spark = built(jvm, template)
    assert {"name": "BAGPIPE_STORAGE_HOSTS", "value": "s3.lab,*.example.com"} in spark["env"]


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
        .with_spec("stack.resources.limits", {"nvidia.com/gpu": 1})
        .with_spec("stack.resources.claims", [{"name": "gpu"}])
        .with_spec("stack.volumeMounts", [{"name": "models", "mountPath": "/opt/models"}])
        .view()
    )
    written = executor_template(job, read_spec(job), 1, Settings())
    template = tmp_path / "executor.yaml"
    template.write_text(yaml.safe_dump(written))
    pod, spark = built(jvm, template)
    kept = pod["spec"]
    for field in (
        "nodeSelector", "tolerations", "affinity", "topologySpreadConstraints",
        "priorityClassName", "runtimeClassName", "imagePullSecrets", "securityContext",
        "resourceClaims",
    ):  # fmt: skip
        assert kept[field] == written["spec"][field], field
    volumes = {v["name"] for v in written["spec"]["volumes"]}
    assert volumes <= {v["name"] for v in kept["volumes"]}
    assert pod["metadata"]["labels"].items() >= written["metadata"]["labels"].items()
    assert pod["metadata"]["annotations"].items() >= written["metadata"]["annotations"].items()
    stack = next(c for c in kept["initContainers"] if c["name"] == "stack")
    expected = next(c for c in written["spec"]["initContainers"] if c["name"] == "stack")
    assert stack["resources"] == {"limits": {"nvidia.com/gpu": "1"}, "claims": [{"name": "gpu"}]}
    for field in ("securityContext", "volumeMounts", "env"):
        assert stack[field] == expected[field], field
    assert spark["securityContext"]["readOnlyRootFilesystem"] is True
