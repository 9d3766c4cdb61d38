"""`bagpipe doctor`: which nodes could take a job's pods, and why none does."""

from typing import Any

import pytest

from bagpipe.cli.health.needs import PodNeed, needs_of
from bagpipe.cli.health.nodes import of_nodes
from bagpipe.cli.health.replies import Answer
from bagpipe.pod_spec import Toleration
from tests.unit.cli.test_doctor import spec

GIB = 1 << 30
NEED = PodNeed("an executor", {"cpu": 2.0, "memory": 5.0 * GIB})
GPU = {"key": "gpu", "value": "yes", "effect": "NoSchedule"}


def node(cpu: str = "4", memory: str = "16Gi", **changed: Any) -> dict[str, Any]:
    """A node that is ready, with labels and taints if they are given."""
    conditions = [{"type": "Ready", "status": changed.pop("ready", "True")}]
    meta = {"labels": changed.pop("labels", {}), "annotations": changed.pop("annotations", {})}
    allocatable = {"cpu": cpu, "memory": memory} | changed.pop("more", {})
    return {
        "metadata": meta, "spec": changed,
        "status": {"allocatable": allocatable, "conditions": conditions},
    }  # fmt: skip


def looked(pod: PodNeed, *nodes: dict[str, Any], more: str = "") -> tuple[str, str]:
    (found,) = of_nodes(Answer(200, {"items": list(nodes), "metadata": {"continue": more}}), [pod])
    return found.state, found.found


def with_(**changed: Any) -> PodNeed:
    return PodNeed(NEED.role, NEED.amounts, **changed)


@pytest.mark.parametrize(("given", "why"), [
    (node(cpu="1900m"), "1 with 1.9 of cpu"),
    (node(memory="5242879Ki"), "1 with 5 GiB of memory"),
    (node(unschedulable=True), "1 closed to pods (cordoned)"),
    (node(ready="Unknown"), "1 not ready"),
    (node(taints=[GPU]), "1 with the taint gpu=yes:NoSchedule"),
])  # fmt: skip
def test_a_node_that_takes_no_executor_says_why(given: dict[str, Any], why: str) -> None:
    state, found = looked(NEED, given)
    assert (state, found) == ("missing", f"none of 1 takes one (2 of cpu, 5 GiB of memory): {why}")
    assert looked(NEED, given, node())[:1] == ("done",)


@pytest.mark.parametrize("given", [
    node("2", "5Gi"), node("2000m", "5242880Ki"),
    node(taints=[GPU | {"effect": "PreferNoSchedule"}]),
    node(taints=[{"key": "node.kubernetes.io/not-ready", "effect": "NoSchedule"}]),
])  # fmt: skip
def test_a_node_that_is_just_enough_takes_one(given: dict[str, Any]) -> None:
    expected = "1 of 1 could take one (2 of cpu, 5 GiB of memory)"
    assert looked(NEED, given) == ("done", expected)


@pytest.mark.parametrize(("toleration", "state"), [
    ({"key": "gpu", "operator": "Exists"}, "done"),
    ({"operator": "Exists"}, "done"),
    ({"key": "gpu", "value": "yes"}, "done"),
    ({"key": "gpu", "operator": "Equal", "value": "yes", "effect": "NoSchedule"}, "done"),
    ({"key": "gpu", "value": "no"}, "missing"),
    ({"key": "gpu", "operator": "Exists", "effect": "NoExecute"}, "missing"),
    ({"key": "other", "operator": "Exists"}, "missing"),
])  # fmt: skip
def test_a_taint_is_tolerated_as_kubernetes_does_it(toleration: dict[str, str], state: str) -> None:
    tolerant = with_(tolerations=[Toleration.model_validate(toleration)])
    assert looked(tolerant, node(taints=[GPU]))[0] == state


def test_labels_decide_and_reasons_are_counted() -> None:
    chosen = with_(selector={"pool": "sim"})
    nodes = [node(), node(), node("1", labels={"pool": "sim"})]
    state, found = looked(chosen, *nodes)
    assert state == "missing"
    assert found.endswith(": 2 without the label pool=sim, 1 with 1 of cpu")
    assert looked(chosen, *nodes, node(labels={"pool": "sim"}))[1].startswith("1 of 4 could")


def test_what_can_t_be_known_is_unknown() -> None:
    karpenter = node("1", labels={"karpenter.sh/nodepool": "a"})
    assert looked(NEED, karpenter)[0] == "unknown"
    assert looked(NEED, node("1"), more="token") == (
        "unknown", "none of the first 1 takes one (2 of cpu, 5 GiB of memory): 1 with 1 of cpu",
    )  # fmt: skip
    assert looked(NEED, node("odd"))[0] == "done"
    (none,) = of_nodes(Answer(200, {"items": []}), [NEED])
    assert (none.state, none.found) == ("unknown", "the cluster has none now")
    (refused,) = of_nodes(Answer(403, {}, "forbidden"), [NEED])
    assert (refused.state, refused.found) == ("unknown", "you may not read nodes")
    assert "affinity was not looked at" in looked(with_(has_affinity=True), node())[1]


def test_nodes_of_several_architectures_are_named() -> None:
    nodes = [node(labels={"kubernetes.io/arch": each}) for each in ("arm64", "amd64", "amd64")]
    found = of_nodes(Answer(200, {"items": nodes}), [NEED])
    assert [(each.what, each.state) for each in found] == [
        ("a node for an executor", "done"), ("architecture", "unknown"),
    ]  # fmt: skip
    assert found[1].found == "the job's pods may come to nodes of amd64 and arm64"
    # Of one that takes no pod nothing has to be known.
    nodes[0]["spec"]["unschedulable"] = True
    assert len(of_nodes(Answer(200, {"items": nodes}), [NEED])) == 1


def test_what_a_job_asks_of_a_node_is_read_off_its_spec() -> None:
    resources = {"requests": {"cpu": "1500m"}, "limits": {"memory": "3Gi", "nvidia.com/gpu": 1}}
    job = spec(
        stack={"image": "i", "command": ["c"], "resources": resources},
        spark={
            "executor": {
                "resources": {"cpu": "500m", "memory": "1Gi"},
                "pod": {"nodeSelector": {"pool": "sim"}, "tolerations": [{"operator": "Exists"}]},
            },
            "driver": {"resources": {"cpu": "250m", "memory": "2Gi"}},
        },
        variants=[{"name": "a"}, {"name": "b", "image": "other"}],
    )
    driver, executor = needs_of(job).pods
    assert driver.amounts == {"cpu": 0.25, "memory": 2.0 * GIB}
    assert executor.amounts == {"cpu": 3.5, "memory": 7.0 * GIB, "nvidia.com/gpu": 2.0}
    assert (executor.selector, len(executor.tolerations)) == ({"pool": "sim"}, 1)
    assert (driver.selector, executor.has_affinity) == ({}, False)
