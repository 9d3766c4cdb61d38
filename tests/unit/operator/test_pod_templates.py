"""What a job says of its pods reaches them, and nothing of it gives them more rights."""

from typing import Any

import pytest

from bagpipe_operator.api.objects import Json
from bagpipe_operator.jobs.pods.job_config import UnusableSpecError, read_spec
from tests.unit.operator.builders import JobBuilder, make_job
from tests.unit.operator.test_manifests import container, driver_of, template_of

POD: Json = {
    "labels": {"team": "lanes", "sim.bagpipe.io/job-uid": "another", "sim.bagpipe.io/role": "x"},
    "annotations": {"cluster-autoscaler.kubernetes.io/safe-to-evict": "false"},
    "nodeSelector": {"gpu": "yes"},
    "tolerations": [{"key": "nvidia.com/gpu", "operator": "Exists", "effect": "NoSchedule"}],
    "affinity": {"nodeAffinity": {"requiredDuringSchedulingIgnoredDuringExecution": {}}},
    "topologySpreadConstraints": [{"topologyKey": "zone", "maxSkew": 2}],
    "priorityClassName": "nightly",
    "runtimeClassName": "nvidia",
    "imagePullSecrets": [{"name": "registry-login"}],
    "resourceClaims": [{"name": "gpu", "resourceClaimTemplateName": "one-gpu"}],
    "securityContext": {"fsGroup": 2000, "supplementalGroups": [3000]},
    "volumes": [
        {"name": "models", "persistentVolumeClaim": {"claimName": "models", "readOnly": True}},
        {"name": "maps", "configMap": {"name": "maps", "items": [{"key": "a", "path": "b/c"}]}},
        {"name": "licence", "secret": {"secretName": "licence", "defaultMode": 288}},
        {"name": "scratch", "emptyDir": {"medium": "Memory", "sizeLimit": "1Gi"}},
        {"name": "both", "projected": {"sources": [{"secret": {"name": "s"}}]}},
    ],
}


def with_pod(role: str, **changed: Any) -> JobBuilder:
    return make_job("x").with_spec(f"spark.{role}.pod", POD | changed)


@pytest.mark.parametrize("role", ["driver", "executor"])
def test_a_role_s_pods_are_as_the_job_says(role: str) -> None:
    pod = driver_of(with_pod(role)) if role == "driver" else template_of(with_pod(role))
    meta, spec = pod["metadata"], pod["spec"]
    assert meta["annotations"].items() >= POD["annotations"].items()
    assert meta["labels"]["team"] == "lanes"
    # Ours count: by them the operator and the garbage collector find what is whose.
    assert (meta["labels"]["sim.bagpipe.io/job-uid"], meta["labels"]["sim.bagpipe.io/role"]) == (
        "uid-of-x", role,
    )  # fmt: skip
    assert spec["nodeSelector"] == {"kubernetes.io/arch": "amd64", "gpu": "yes"}
    for field in ("affinity", "priorityClassName", "runtimeClassName"):
        assert spec[field] == POD[field]
    assert spec["imagePullSecrets"] == [{"name": "registry-login"}]
    assert spec["resourceClaims"] == [{"name": "gpu", "resourceClaimTemplateName": "one-gpu"}]
    assert [t["key"] for t in spec["tolerations"]] == [
        "node.kubernetes.io/not-ready", "node.kubernetes.io/unreachable", "nvidia.com/gpu",
    ]  # fmt: skip
    assert spec["topologySpreadConstraints"] == [
        {
            "topologyKey": "zone",
            "maxSkew": 2,
            "whenUnsatisfiable": "ScheduleAnyway",
            "labelSelector": {
                "matchLabels": {"sim.bagpipe.io/job-uid": "uid-of-x", "sim.bagpipe.io/role": role}
            },
        }
    ]
    assert spec["securityContext"] == {
        "fsGroup": 2000,
        "fsGroupChangePolicy": "OnRootMismatch",
        "supplementalGroups": [3000],
        "seccompProfile": {"type": "RuntimeDefault"},
    }
    ours = [v for v in spec["volumes"] if v["name"] in {u["name"] for u in POD["volumes"]}]
    assert [v if v["name"] != "scratch" else POD["volumes"][3] for v in ours] == POD["volumes"]


def test_a_gpu_and_volumes_reach_the_stack_alone() -> None:
    job = (
        with_pod("executor")
        .with_spec("stack.resources", {"limits": {"nvidia.com/gpu": 1, "memory": "8Gi"}})
        .with_spec("stack.volumeMounts", [{"name": "models", "mountPath": "/opt/models"}])
        .with_spec("stack.envFrom", [{"prefix": "L_", "secretRef": {"name": "licence"}}])
        .with_spec("spark.executor.volumeMounts", [{"name": "maps", "mountPath": "/mnt/maps"}])
    )
    pod = template_of(job)
    stack, spark = container(pod, "stack"), container(pod, "spark")
    assert stack["resources"] == {"limits": {"nvidia.com/gpu": 1, "memory": "8Gi"}}
    assert stack["volumeMounts"][-1] == {"name": "models", "mountPath": "/opt/models"}
    assert stack["envFrom"] == [{"prefix": "L_", "secretRef": {"name": "licence"}}]
    assert spark["volumeMounts"][-1] == {"name": "maps", "mountPath": "/mnt/maps"}
    assert "licence" not in str(spark)
    assert "models" not in str(spark["volumeMounts"])


def test_values_that_only_the_kubelet_knows_are_in_the_container_and_not_in_the_case() -> None:
    key = {"secretKeyRef": {"name": "licence", "key": "key"}}
    env = [{"name": "LICENCE", "value": "", "valueFrom": key}, {"name": "A", "value": "b"}]
    stack = container(template_of(make_job("x").with_spec("stack.env", env)), "stack")
    assert stack["env"] == [
        {"name": "HOME", "value": "/bagpipe/home"},
        {"name": "USER", "value": "bagpipe"},
        {"name": "LICENCE", "valueFrom": key},
    ]


RESTRICTED: Json = {
    "allowPrivilegeEscalation": False,
    "capabilities": {"drop": ["ALL"]},
    "readOnlyRootFilesystem": True,
    "runAsNonRoot": True,
    "seccompProfile": {"type": "RuntimeDefault"},
}


@pytest.mark.parametrize(
    ("text", "differs"),
    [
        ({}, {"runAsUser": 65532, "runAsGroup": 65532}),
        ({"runAsUser": 1000}, {"runAsUser": 1000, "runAsGroup": 1000}),
        ({"runAsUser": 1000, "runAsGroup": 5}, {"runAsUser": 1000, "runAsGroup": 5}),
        ({"runAsNonRoot": False}, {"runAsNonRoot": False}),
        (
            {"runAsNonRoot": False, "runAsUser": 0, "capabilities": {"drop": []}},
            {"runAsNonRoot": False, "runAsUser": 0, "runAsGroup": 0, "capabilities": {"drop": []}},
        ),
        (
            {"readOnlyRootFilesystem": False},
            {"readOnlyRootFilesystem": False, "runAsUser": 65532, "runAsGroup": 65532},
        ),
        # What the API server refuses would not get through here either.
        (
            {"privileged": True, "allowPrivilegeEscalation": True, "capabilities": {"add": ["X"]}},
            {"runAsUser": 65532, "runAsGroup": 65532},
        ),
    ],
)
def test_the_stack_is_restricted_but_for_what_the_job_loosens(text: Json, differs: Json) -> None:
    pod = template_of(make_job("x").with_spec("stack.securityContext", text))
    assert container(pod, "stack")["securityContext"] == RESTRICTED | differs


def test_the_image_s_own_user_keeps_its_home() -> None:
    job = make_job("x").with_spec("stack.securityContext", {"runAsNonRoot": False})
    assert container(template_of(job), "stack")["env"] == []


def test_a_volume_of_the_user_may_take_the_place_of_tmp() -> None:
    mounts = [{"name": "scratch", "mountPath": "/tmp"}]
    pod = template_of(with_pod("executor").with_spec("stack.volumeMounts", mounts))
    paths = [m["mountPath"] for m in container(pod, "stack")["volumeMounts"]]
    assert paths == ["/bagpipe/shared", "/bagpipe/home", "/tmp"]


def test_only_the_driver_s_container_has_a_token() -> None:
    pod = driver_of(make_job("x"))
    assert pod["spec"]["automountServiceAccountToken"] is False
    token = [v for v in pod["spec"]["volumes"] if "serviceAccountToken" in str(v)]
    assert [v["name"] for v in token] == ["bagpipe-token"]
    assert {
        "name": "bagpipe-token",
        "mountPath": "/var/run/secrets/kubernetes.io/serviceaccount",
        "readOnly": True,
    } in container(pod, "driver")["volumeMounts"]
    assert "serviceAccountToken" not in str(template_of(make_job("x"))["spec"]["volumes"])


ESCAPES = {
    "the node's files": {"volumes": [{"name": "node", "hostPath": {"path": "/"}}]},
    "a token among others": {
        "volumes": [
            {"name": "t", "projected": {"sources": [{"serviceAccountToken": {"path": "t"}}]}}
        ]
    },
    "our own volume": {"volumes": [{"name": "bagpipe-token", "emptyDir": {}}]},
    "a second kind": {"volumes": [{"name": "a", "emptyDir": {}, "secret": {"secretName": "b"}}]},
}


@pytest.mark.parametrize("case", [c for c in ESCAPES if c != "a token among others"])
@pytest.mark.parametrize("role", ["driver", "executor"])
def test_a_volume_that_a_wider_crd_lets_pass_ends_the_job(case: str, role: str) -> None:
    with pytest.raises(UnusableSpecError, match=rf"spec\.spark\.{role}\.pod\.volumes"):
        read_spec(make_job("x").with_spec(f"spark.{role}.pod", ESCAPES[case]).view())


def test_a_projected_token_never_reaches_a_pod() -> None:
    job = make_job("x").with_spec("spark.executor.pod", ESCAPES["a token among others"])
    assert "serviceAccountToken" not in str(template_of(job))


@pytest.mark.parametrize(
    "path", ["/opt/bagpipe", "/mnt/../etc", "/mnt", "/etc/bagpipe", "/mnt/a:b"]
)
def test_nothing_is_mounted_over_spark_s_programs(path: str) -> None:
    mounts = [{"name": "models", "mountPath": path}]
    for role in ("driver", "executor"):
        with pytest.raises(UnusableSpecError, match="mountPath"):
            read_spec(make_job("x").with_spec(f"spark.{role}.volumeMounts", mounts).view())


@pytest.mark.parametrize("path", ["/", "/bagpipe/shared", "/proc/1", "/dev", "tmp", "/a/../proc"])
def test_nothing_is_mounted_over_the_agent(path: str) -> None:
    mounts = [{"name": "models", "mountPath": path}]
    with pytest.raises(UnusableSpecError, match="mountPath"):
        read_spec(make_job("x").with_spec("stack.volumeMounts", mounts).view())


DANGEROUS = (
    "hostNetwork", "hostPID", "hostIPC", "hostUsers", "serviceAccountName", "nodeName",
    "automountServiceAccountToken", "containers", "initContainers", "ephemeralContainers",
    "shareProcessNamespace", "hostAliases", "ownerReferences", "finalizers", "namespace", "name",
)  # fmt: skip


@pytest.mark.parametrize("field", DANGEROUS)
@pytest.mark.parametrize("value", [True, "another", 0, {"a": "b"}, [{"name": "a", "image": "b"}]])
def test_no_field_but_the_named_ones_changes_a_pod(field: str, value: object) -> None:
    plain = make_job("x").with_spec("spark.driver.pod", {}).with_spec("spark.executor.pod", {})
    wide = make_job("x")
    for role in ("driver", "executor"):
        wide = wide.with_spec(f"spark.{role}.pod", {field: value})
    assert driver_of(wide) == driver_of(plain)
    assert template_of(wide) == template_of(plain)
