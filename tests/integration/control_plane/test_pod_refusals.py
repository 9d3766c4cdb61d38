"""What a job's pod template may not say: the real API server refuses it and says what to write."""

import json
import re
from pathlib import Path
from typing import Any

import pytest
import yaml
from embedded.api import ApiError

from tests.integration.control_plane.client import Client, Object, jobs
from tests.unit.crds.test_crd import LARGEST_BYTES
from tests.unit.operator.builders import make_job
from tests.unit.operator.test_pod_templates import POD

pytestmark = pytest.mark.integration


def tried(admin: Client, namespace: str, path: str, value: Any) -> Object:
    """A job with one change, judged by the API server and not kept."""
    job = make_job("x").with_spec(path, value).as_written()
    return admin.create(jobs(namespace) + "?dryRun=All&fieldValidation=Strict", job)


TAKEN: dict[str, tuple[str, Any]] = {
    "all of a pod": ("spark.executor.pod", POD | {"labels": {"team": "lanes"}}),
    "the driver's too": ("spark.driver.pod", POD | {"labels": {"team": "lanes"}}),
    "a GPU": ("stack.resources", {"limits": {"nvidia.com/gpu": 1, "ephemeral-storage": "2Gi"}}),
    "a claim of devices": (
        "spark.executor.pod.resourceClaims", [{"name": "gpu", "resourceClaimName": "shared"}],
    ),
    "mounts": (
        "stack.volumeMounts",
        [{"name": "m", "mountPath": "/opt/models", "subPath": "a/b", "readOnly": True}],
    ),
    "shared memory": ("stack.volumeMounts", [{"name": "m", "mountPath": "/dev/shm"}]),
    "a folder of Spark's": ("spark.driver.volumeMounts", [{"name": "m", "mountPath": "/mnt/m"}]),
    "a value from a Secret": (
        "stack.env", [{"name": "K", "valueFrom": {"secretKeyRef": {"name": "l", "key": "k"}}}],
    ),
    "a Secret's values": ("stack.envFrom", [{"prefix": "L_", "secretRef": {"name": "l"}}]),
    "root, stated twice": ("stack.securityContext", {"runAsNonRoot": False, "runAsUser": 0}),
    "the image's user": ("stack.securityContext", {"runAsNonRoot": False}),
    "files on a volume": ("source.bags", ["file:///mnt/data/*.bag"]),
}  # fmt: skip


@pytest.mark.parametrize("case", TAKEN)
def test_what_users_need_is_taken_and_kept(admin: Client, namespace: str, case: str) -> None:
    path, value = TAKEN[case]
    kept = tried(admin, namespace, path, value)["spec"]
    for part in path.split("."):
        kept = kept[part]
    assert with_what_was_written(kept, value) == value


def test_the_job_of_the_task_page_is_taken(admin: Client, namespace: str) -> None:
    page = Path(__file__).parents[3] / "docs/tasks/pod-templates.md"
    (text,) = re.findall(r"```yaml\n(.*?)```", page.read_text(), re.DOTALL)
    job = yaml.safe_load(text)
    kept = admin.create(jobs(namespace) + "?dryRun=All&fieldValidation=Strict", job)
    assert kept["spec"]["stack"]["resources"]["limits"]["nvidia.com/gpu"] == 1


def with_what_was_written(kept: Any, written: Any) -> Any:
    """What is kept of what was written; defaults aside."""
    if isinstance(written, dict):
        return {key: with_what_was_written(kept[key], written[key]) for key in written}
    if isinstance(written, list):
        return [with_what_was_written(a, b) for a, b in zip(kept, written, strict=True)]
    return kept


POD_PATH = "spark.executor.pod"
MOUNT = {"name": "m"}
REFUSED: dict[str, tuple[str, Any, str]] = {
    "hostPath": (
        POD_PATH, {"volumes": [{"name": "n", "hostPath": {"path": "/"}}]},
        "hostPath would open the node's files to the job: write a persistentVolumeClaim",
    ),
    "a token": (
        POD_PATH,
        {"volumes": [{"name": "n", "projected": {"sources": [{"secret": None}]}}]},
        "never the token of a ServiceAccount: write for example configMap",
    ),
    "our volume's name": (
        POD_PATH, {"volumes": [{"name": "bagpipe-token", "emptyDir": {}}]},
        "one of Bagpipe's or Spark's own: write another",
    ),
    "no kind of volume": (POD_PATH, {"volumes": [{"name": "n"}]}, "a volume is exactly one of"),
    "hostNetwork": (POD_PATH, {"hostNetwork": True}, "out of its own walls: write none of them"),
    "hostPID": (POD_PATH, {"hostPID": True}, "out of its own walls: write none of them"),
    "hostIPC": (POD_PATH, {"hostIPC": True}, "out of its own walls: write none of them"),
    "an account": (
        POD_PATH, {"serviceAccountName": "admin"},
        "a job can't choose its ServiceAccount, since another one's rights would be the job's",
    ),
    "a node": (POD_PATH, {"nodeName": "n"}, "past the scheduler and its limits: write nodeS"),
    "a container": (POD_PATH, {"containers": [{"name": "c"}]}, "write what the stack needs in"),
    "a first container": (POD_PATH, {"initContainers": [{"name": "c"}]}, "only Bagpipe's cont"),
    "our label": (
        POD_PATH, {"labels": {"sim.bagpipe.io/job-uid": "x"}}, "write a key of your own",
    ),
    "Spark's label": (POD_PATH, {"labels": {"spark-role": "x"}}, "write a key of your own"),
    "a profile by annotation": (
        POD_PATH,
        {"annotations": {"container.apparmor.security.beta.kubernetes.io/stack": "unconfined"}},
        "AppArmor's and seccomp's profiles stay the runtime's: write a key of your own",
    ),
    "the cluster's priority": (
        POD_PATH, {"priorityClassName": "system-node-critical"},
        "for the cluster's own pods: write a PriorityClass",
    ),
    "Spark's user": (
        POD_PATH, {"securityContext": {"runAsUser": 0}},
        "the users of Bagpipe's own containers are fixed: write stack.securityContext.runAsUser",
    ),
    "over Spark's programs": (
        "spark.driver.volumeMounts", [MOUNT | {"mountPath": "/opt/bagpipe"}],
        "programs and rights elsewhere: write a mountPath below /mnt",
    ),
    "out of /mnt": (
        "spark.executor.volumeMounts", [MOUNT | {"mountPath": "/mnt/../etc"}],
        "must be a plain path below the root",
    ),
    "over the agent": (
        "stack.volumeMounts", [MOUNT | {"mountPath": "/bagpipe/shared"}],
        "where the agent or the kernel has its files: write another",
    ),
    "over devices": ("stack.volumeMounts", [MOUNT | {"mountPath": "/dev"}], "write another"),
    "out of a volume": (
        "stack.volumeMounts", [MOUNT | {"mountPath": "/a", "subPath": "../b"}],
        "subPath must stay in its volume",
    ),
    "privileged": (
        "stack.securityContext", {"privileged": True},
        "would own its node: write for a GPU resources.limits",
    ),
    "capabilities": (
        "stack.securityContext", {"capabilities": {"add": ["SYS_ADMIN"]}},
        "power over its node: write only drop",
    ),
    "sudo": (
        "stack.securityContext", {"allowPrivilegeEscalation": True},
        "can't gain rights while it runs, for example by sudo: write runAsNonRoot: false",
    ),
    "root by chance": (
        "stack.securityContext", {"runAsUser": 0}, "write runAsNonRoot: false beside it",
    ),
    "value and valueFrom": (
        "stack.env",
        [{"name": "A", "value": "b", "valueFrom": {"fieldRef": {"fieldPath": "spec.nodeName"}}}],
        "write only one of the two",
    ),
    "two sources": (
        "stack.envFrom", [{"secretRef": {"name": "a"}, "configMapRef": {"name": "b"}}],
        "names one Secret or one ConfigMap: write for example secretRef",
    ),
    "no quantity": (
        "stack.resources", {"limits": {"nvidia.com/gpu": "one"}}, "1 of nvidia.com/gpu",
    ),
    "a claim of nobody": (
        "stack.resources", {"claims": [{"name": "gpu"}]},
        "that spark.executor.pod.resourceClaims lacks: write the claim there",
    ),
    "a claim by two names": (
        "spark.executor.pod.resourceClaims",
        [{"name": "gpu", "resourceClaimName": "a", "resourceClaimTemplateName": "b"}],
        "write resourceClaimName or resourceClaimTemplateName",
    ),
    "the pod's own files as bags": (
        "source.bags", ["file:///proc/self/environ"], "reaches only what is mounted below /mnt",
    ),
    "results among Spark's files": (
        "output.uri", "file:///opt/bagpipe/lib", "reaches only what is mounted below /mnt",
    ),
}  # fmt: skip


@pytest.mark.parametrize("case", REFUSED)
def test_what_gives_more_rights_is_refused_with_what_to_write(
    admin: Client, namespace: str, case: str
) -> None:
    path, value, sentence = REFUSED[case]
    with pytest.raises(ApiError) as refused:
        tried(admin, namespace, path, value)
    assert refused.value.status == 422
    message = str(refused.value)
    assert sentence in message, message


@pytest.mark.parametrize("field", ["hostUsers", "shareProcessNamespace", "dnsPolicy"])
def test_a_field_that_does_not_exist_is_named(admin: Client, namespace: str, field: str) -> None:
    with pytest.raises(ApiError, match=rf'unknown field "spec.spark.executor.pod.{field}'):
        tried(admin, namespace, POD_PATH, {field: True})


def test_a_token_is_no_source_of_a_projected_volume(admin: Client, namespace: str) -> None:
    source = {"serviceAccountToken": {"path": "token"}}
    volumes = [{"name": "n", "projected": {"sources": [source]}}]
    with pytest.raises(ApiError, match="serviceAccountToken"):
        tried(admin, namespace, POD_PATH, {"volumes": volumes})
    # A client that asks for no strict answer is refused too: the source is empty without it.
    job = make_job("x").with_spec(POD_PATH, {"volumes": volumes}).as_written()
    with pytest.raises(ApiError, match="never the token of a ServiceAccount"):
        admin.create(jobs(namespace) + "?dryRun=All&fieldValidation=Ignore", job)


def test_the_definition_is_small_enough_as_it_is_served(admin: Client) -> None:
    path = "/apis/apiextensions.k8s.io/v1/customresourcedefinitions/simulationjobs.sim.bagpipe.io"
    served = admin.get(path)
    size = len(json.dumps({"spec": served["spec"]}))
    assert size < LARGEST_BYTES, size
