"""The driver's pod and the executors' template, field by field where it matters."""

from typing import Any

import pytest

from bagpipe_operator.api.nesting import DEEPEST
from bagpipe_operator.api.objects import Json
from bagpipe_operator.jobs.pods.driver_pod import driver_pod
from bagpipe_operator.jobs.pods.executor_template import executor_template
from bagpipe_operator.jobs.pods.job_config import UnusableSpecError, job_config, read_spec
from bagpipe_operator.settings import Settings
from tests.unit.operator.builders import JobBuilder, make_job

SETTINGS = Settings(spark_image="r/spark:1", agent_image="r/agent:1")
SCRAPED = {
    "prometheus.io/scrape": "true",
    "prometheus.io/port": "8080",
    "prometheus.io/path": "/metrics",
}
AGENT = "/bagpipe/shared/bin/bagpipe-agent"


def driver_of(builder: JobBuilder) -> Json:
    job = builder.view()
    return driver_pod(job, read_spec(job), 1, SETTINGS, "x-1-0a")


def template_of(builder: JobBuilder) -> Json:
    job = builder.view()
    return executor_template(job, read_spec(job), 1, SETTINGS)


def container(pod: Json, name: str) -> Any:
    spec = pod["spec"]
    everything = [*spec.get("initContainers", []), *spec["containers"]]
    return next(c for c in everything if c["name"] == name)


def test_pods_are_annotated_for_prometheus_and_the_job_has_the_last_word() -> None:
    own = {"prometheus.io/scrape": "false"}
    agents = SCRAPED | {"prometheus.io/port": "9811"}
    assert template_of(make_job("x"))["metadata"]["annotations"] == agents
    builder = make_job("x")
    for role in ("driver", "executor"):
        builder = builder.with_spec(f"spark.{role}.pod", {"annotations": own})
    assert driver_of(builder)["metadata"]["annotations"] == SCRAPED | own
    assert template_of(builder)["metadata"]["annotations"] == agents | own
    job = make_job("x").view()
    silent = Settings(scrape_annotations=False)
    assert "annotations" not in driver_pod(job, read_spec(job), 1, silent, "x-1-0a")["metadata"]
    assert "annotations" not in executor_template(job, read_spec(job), 1, silent)["metadata"]


def test_the_driver_is_owned_labelled_and_never_restarted() -> None:
    pod = driver_of(make_job("x"))
    assert pod["metadata"] == {
        "name": "x-1-driver",
        "namespace": "lanes",
        "labels": {
            "app.kubernetes.io/managed-by": "bagpipe",
            "sim.bagpipe.io/job": "x",
            "sim.bagpipe.io/job-uid": "uid-of-x",
            "sim.bagpipe.io/role": "driver",
            "sim.bagpipe.io/attempt": "1",
        },
        "annotations": SCRAPED,
        "ownerReferences": [
            {
                "apiVersion": "sim.bagpipe.io/v1alpha1",
                "kind": "SimulationJob",
                "name": "x",
                "uid": "uid-of-x",
                "controller": True,
                "blockOwnerDeletion": False,
            }
        ],
    }
    spec = pod["spec"]
    assert (spec["restartPolicy"], spec["serviceAccountName"]) == ("Never", "bagpipe-driver")
    assert spec["enableServiceLinks"] is False


def test_the_driver_s_container() -> None:
    pod = driver_of(make_job("x").with_spec("spark.driver.resources", {"memory": "2Gi"}))
    driver = container(pod, "driver")
    assert driver["args"] == ["driver", "--job", "/etc/bagpipe/job.json"]
    assert driver["image"] == "r/spark:1"
    assert driver["resources"] == {
        "requests": {"cpu": "500m", "memory": "2Gi"},
        "limits": {"memory": "2Gi"},
    }
    fields = {
        e["name"]: e["valueFrom"]["fieldRef"]["fieldPath"]
        for e in driver["env"]
        if "valueFrom" in e
    }
    assert fields == {
        "BAGPIPE_POD_IP": "status.podIP",
        "BAGPIPE_POD_NAME": "metadata.name",
        "BAGPIPE_NAMESPACE": "metadata.namespace",
    }
    assert {"name": "SPARK_DRIVER_MEMORY", "value": "1024m"} in driver["env"]
    assert {"name": "SPARK_USER", "value": "bagpipe"} in driver["env"]
    assert driver["ports"] == [{"name": "progress", "containerPort": 8080}]


@pytest.mark.parametrize("name", ["driver", "agent", "spark"])
def test_our_own_containers_are_restricted(name: str) -> None:
    pod = driver_of(make_job("x")) if name == "driver" else template_of(make_job("x"))
    assert container(pod, name)["securityContext"] == {
        "allowPrivilegeEscalation": False,
        "capabilities": {"drop": ["ALL"]},
        "readOnlyRootFilesystem": True,
        "runAsNonRoot": True,
        "runAsUser": 10001,
        "runAsGroup": 10001,
        "seccompProfile": {"type": "RuntimeDefault"},
    }


def test_recordings_are_read_only_and_outputs_are_not() -> None:
    for pod, name in ((driver_of(make_job("x")), "driver"), (template_of(make_job("x")), "spark")):
        claims = {
            v["name"]: v["persistentVolumeClaim"]["claimName"]
            for v in pod["spec"]["volumes"]
            if "persistentVolumeClaim" in v
        }
        mounts = {
            claims[m["name"]]: (m["mountPath"], m["readOnly"])
            for m in container(pod, name)["volumeMounts"]
            if m["name"] in claims
        }
        assert mounts == {
            "recordings": ("/bagpipe/volumes/recordings", True),
            "results": ("/bagpipe/volumes/results", False),
        }


def test_a_claim_that_is_both_is_writable_and_mounted_once() -> None:
    pod = driver_of(make_job("x").with_spec("output.uri", "pvc://recordings/out"))
    everything = container(pod, "driver")["volumeMounts"]
    mounts = [m for m in everything if m["name"].startswith("claim-")]
    assert mounts == [
        {"name": "claim-0", "mountPath": "/bagpipe/volumes/recordings", "readOnly": False}
    ]


def test_the_stack_runs_the_agent_in_the_user_s_image() -> None:
    job = (
        make_job("x")
        .with_spec("spark.slots", 4)
        .with_spec("stack.resources", {"limits": {"memory": "2Gi"}})
        .with_spec("stack.imagePullPolicy", "Never")
    )
    pod = template_of(job)
    assert [c["name"] for c in pod["spec"]["initContainers"]] == ["agent", "stack"]
    agent, stack = container(pod, "agent"), container(pod, "stack")
    assert agent["command"] == ["/bagpipe-agent", "install", "/bagpipe/shared"]
    assert agent["image"] == "r/agent:1"
    assert (stack["image"], stack["imagePullPolicy"]) == ("example/lane:1", "Never")
    assert stack["restartPolicy"] == "Always"
    assert stack["command"] == [
        AGENT, "serve", "--shared", "/bagpipe/shared", "--slots", "4", "--metrics", "0.0.0.0:9811",
    ]  # fmt: skip
    assert stack["ports"] == [{"name": "metrics", "containerPort": 9811}]
    assert stack["lifecycle"]["postStart"]["exec"]["command"] == [
        AGENT, "ready", "--shared", "/bagpipe/shared", "--wait", "120",
    ]  # fmt: skip
    assert stack["resources"] == {"limits": {"memory": "2Gi"}}
    assert [m["mountPath"] for m in stack["volumeMounts"]] == [
        "/bagpipe/shared", "/tmp", "/bagpipe/home",
    ]  # fmt: skip


def test_secrets_reach_our_containers_and_never_the_stack_s() -> None:
    job = make_job("x").with_spec("storage.secrets", ["s3-login", "hdfs-user"])
    expected = [
        {"prefix": "BAGPIPE_SECRET_0_", "secretRef": {"name": "s3-login"}},
        {"prefix": "BAGPIPE_SECRET_1_", "secretRef": {"name": "hdfs-user"}},
    ]
    template = template_of(job)
    assert container(driver_of(job), "driver")["envFrom"] == expected
    assert container(template, "spark")["envFrom"] == expected
    for name in ("agent", "stack"):
        assert not container(template, name).get("envFrom")
        assert "login" not in str(container(template, name))


def test_executors_have_an_account_of_their_own() -> None:
    assert template_of(make_job("x"))["spec"]["serviceAccountName"] == "bagpipe-executor"


def test_each_image_of_the_variants_is_a_container_with_slots_of_its_own() -> None:
    builder = make_job("x").with_spec(
        "variants", [{"name": "released"}, {"name": "pr-812", "image": "r/lane:pr-812"}]
    )
    inits = template_of(builder)["spec"]["initContainers"]
    assert [c["name"] for c in inits] == ["agent", "stack", "stack-1"]
    first, second = inits[1], inits[2]
    assert second["image"] == "r/lane:pr-812"
    assert second["command"][1:4] == ["serve", "--shared", "/bagpipe/shared/image-1"]
    hook = second["lifecycle"]["postStart"]["exec"]["command"]
    assert hook[1:4] == ["ready", "--shared", "/bagpipe/shared/image-1"]
    # They share the pod's address.
    assert second["command"][-2:] == ["--metrics", "0.0.0.0:9812"]
    assert second["ports"] == [{"name": "metrics-1", "containerPort": 9812}]
    own = ("name", "image", "command", "lifecycle", "ports")
    assert {k: v for k, v in first.items() if k not in own} == {
        k: v for k, v in second.items() if k not in own
    }


def test_variants_of_one_image_share_its_container() -> None:
    builder = make_job("x").with_spec("variants", [{"name": "a"}, {"name": "b"}])
    inits = template_of(builder)["spec"]["initContainers"]
    assert [c["name"] for c in inits] == ["agent", "stack"]


def test_evaluators_are_mounted_beside_the_worker_alone() -> None:
    builder = make_job("x").with_spec(
        "evaluate",
        [{"name": n, "own": {"configMap": "lane", "file": f"{n}.py"}} for n in ("a", "b")],
    )
    pod = template_of(builder)
    mount = {
        "name": "evaluator-0",
        "mountPath": "/etc/bagpipe/evaluators/lane",
        "readOnly": True,
    }
    assert [m for m in container(pod, "spark")["volumeMounts"] if "evaluator" in m["name"]] == [
        mount
    ]
    assert not [m for m in container(pod, "stack")["volumeMounts"] if "evaluator" in m["name"]]
    assert {"name": "evaluator-0", "configMap": {"name": "lane"}} in pod["spec"]["volumes"]


def test_evaluators_and_credentials_exclude_each_other() -> None:
    builder = (
        make_job("x")
        .with_spec("evaluate", [{"name": "a", "own": {"configMap": "lane"}}])
        .with_spec("storage", {"secrets": ["login"]})
    )
    with pytest.raises(UnusableSpecError, match=r"could read what storage\.secrets give"):
        read_spec(builder.view())


def test_executors_get_no_token_and_share_memory() -> None:
    spec = template_of(make_job("x"))["spec"]
    assert spec["automountServiceAccountToken"] is False
    assert spec["enableServiceLinks"] is False
    assert spec["volumes"][0] == {
        "name": "shared",
        "emptyDir": {"medium": "Memory", "sizeLimit": "64Mi"},
    }
    assert template_of(make_job("x"))["metadata"]["labels"]["sim.bagpipe.io/role"] == "executor"


def test_the_config_can_not_change_under_the_driver() -> None:
    job = make_job("x").view()
    config = job_config(job, read_spec(job), 1, SETTINGS)
    assert config["immutable"] is True
    assert sorted(config["data"]) == ["executor.yaml", "job.json"]


def test_a_spec_that_can_not_be_run_names_the_place() -> None:
    job = make_job("x").with_spec("stack.parameters", {"a": 1}).view()
    with pytest.raises(UnusableSpecError, match=r"spec\.stack\.parameters.*write /a"):
        read_spec(job)


def test_what_is_nested_too_deep_to_be_read_whole_is_refused() -> None:
    def nested(levels: int) -> list[Any]:
        value: list[Any] = []
        for _ in range(levels - 1):
            value = [value]
        return value

    # spec, stack, parameters and the value of /x: what is in it begins at the fourth level.
    legal = make_job("x").with_spec("stack.parameters", {"/x": nested(DEEPEST - 4)}).view()
    assert read_spec(legal).stack.parameters["/x"] == nested(DEEPEST - 4)
    for levels in (DEEPEST - 3, DEEPEST, 5 * DEEPEST):
        job = make_job("x").with_spec("stack.parameters", {"/x": nested(levels)}).view()
        with pytest.raises(UnusableSpecError, match="32 deep in each other"):
            read_spec(job)


@pytest.mark.timeout(20)
def test_no_pattern_of_a_user_s_takes_the_operator_s_time() -> None:
    presence = {"name": "p", "presence": {"topic": "/" + "a" * 50, "min": 1}}
    job = make_job("x").with_spec("record.topics", ["/(a+)+b"]).with_spec("evaluate", [presence])
    with pytest.raises(UnusableSpecError, match=r"record\.topics does not have"):
        read_spec(job.view())
    # RE2 and Rust's regex have no look-ahead; the agent refuses it with a sentence.
    job = job.with_spec("record.topics", ["/(?=a)a+"])
    assert read_spec(job.view()).record is not None
