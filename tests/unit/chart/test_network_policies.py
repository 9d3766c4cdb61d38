"""Which connections the chart's NetworkPolicies let through, worked out for the pods that we make.

A small reading of networking.k8s.io/v1, as far as the chart uses it. That a network plugin does
the same is shown by tests/e2e/test_network_policies.py, on a cluster that has one.
"""

import json
from dataclasses import dataclass

import pytest
import yaml

from charts.monitoring.generate import ROOT
from tests.unit.chart.test_chart import Object, of_kind, rendered
from tests.unit.operator.builders import make_job
from tests.unit.operator.test_manifests import driver_of, template_of

MONITORING = {"namespaceSelector": {"matchLabels": {"kubernetes.io/metadata.name": "monitoring"}}}
ON = ('jobNamespaces=["lanes","maps"]', "networkPolicy.enabled=true")


@dataclass(frozen=True)
class Pod:
    """Where a pod is and what it is called."""

    namespace: str
    labels: tuple[tuple[str, str], ...]

    @classmethod
    def of(cls, namespace: str, manifest: Object) -> "Pod":
        return cls(namespace, tuple(manifest["metadata"]["labels"].items()))


def matches(selector: Object, labels: dict[str, str]) -> bool:
    assert set(selector) <= {"matchLabels"}, "this reading knows no other selector"
    wanted = selector.get("matchLabels", {})
    return all(labels.get(key) == value for key, value in wanted.items())


def is_peer(peer: Object, policy_namespace: str, source: Pod) -> bool:
    assert set(peer) <= {"podSelector", "namespaceSelector"}
    spaces = peer.get("namespaceSelector")
    if spaces is None and source.namespace != policy_namespace:
        return False
    if spaces is not None and not matches(
        spaces, {"kubernetes.io/metadata.name": source.namespace}
    ):
        return False
    return matches(peer.get("podSelector", {}), dict(source.labels))


def within(port: int, ports: Object) -> bool:
    assert set(ports) <= {"port", "endPort", "protocol"}
    first: int = ports["port"]
    last: int = ports.get("endPort", first)
    return first <= port <= last


def allowed(policies: list[Object], source: Pod, target: Pod, port: int) -> bool:
    """Whether an enforcing plugin lets the connection through."""
    own = [
        p for p in policies
        if p["metadata"]["namespace"] == target.namespace
        and matches(p["spec"]["podSelector"], dict(target.labels))
    ]  # fmt: skip
    return not own or any(
        any(is_peer(peer, target.namespace, source) for peer in rule["from"])
        and ("ports" not in rule or any(within(port, ports) for ports in rule["ports"]))
        for policy in own
        for rule in policy["spec"].get("ingress", [])
    )


def operator_of(objects: list[Object]) -> Pod:
    (deployment,) = of_kind(objects, "Deployment")
    return Pod.of("bagpipe-system", deployment["spec"]["template"])


DRIVER, EXECUTOR = driver_of(make_job("x")), template_of(make_job("x"))
HERE = {"driver": Pod.of("lanes", DRIVER), "executor": Pod.of("lanes", EXECUTOR)}
ELSEWHERE = {"driver": Pod.of("maps", DRIVER), "executor": Pod.of("maps", EXECUTOR)}
STRANGER = Pod("lanes", (("app", "web"),))
SPARK_PORT, PROGRESS, ROS_MASTER, AGENT = 38211, 8080, 11311, 9811


def test_none_are_made_unless_asked_for() -> None:
    assert of_kind(rendered(), "NetworkPolicy") == []


def test_one_for_each_role_and_namespace_and_one_for_the_operator() -> None:
    policies = of_kind(rendered(*ON), "NetworkPolicy")
    where = [(p["metadata"]["namespace"], p["metadata"]["name"]) for p in policies]
    assert where == [
        ("lanes", "bagpipe-driver"), ("lanes", "bagpipe-executor"),
        ("maps", "bagpipe-driver"), ("maps", "bagpipe-executor"),
        ("bagpipe-system", "bagpipe-operator"),
    ]  # fmt: skip
    # Storage may be anywhere: the policies do not restrict outgoing connections.
    assert all(p["spec"]["policyTypes"] == ["Ingress"] for p in policies)


def test_who_reaches_whom() -> None:
    objects = rendered(*ON)
    policies, operator = of_kind(objects, "NetworkPolicy"), operator_of(objects)
    driver, executor = HERE["driver"], HERE["executor"]
    open_ways = [
        (executor, driver, SPARK_PORT), (executor, driver, PROGRESS),
        (driver, executor, SPARK_PORT), (executor, executor, SPARK_PORT),
        (operator, driver, PROGRESS),
    ]  # fmt: skip
    assert [allowed(policies, *way) for way in open_ways] == [True] * len(open_ways)
    closed = [
        (operator, driver, SPARK_PORT), (operator, executor, PROGRESS),
        (STRANGER, driver, SPARK_PORT), (STRANGER, driver, PROGRESS),
        (STRANGER, executor, SPARK_PORT), (STRANGER, executor, ROS_MASTER),
        (STRANGER, executor, AGENT), (operator, executor, AGENT),
        (ELSEWHERE["executor"], driver, SPARK_PORT), (ELSEWHERE["executor"], driver, PROGRESS),
        (ELSEWHERE["driver"], executor, SPARK_PORT),
        (ELSEWHERE["executor"], executor, ROS_MASTER),
        (executor, operator, PROGRESS), (driver, operator, PROGRESS),
        (STRANGER, operator, PROGRESS),
    ]  # fmt: skip
    assert [allowed(policies, *way) for way in closed] == [False] * len(closed)


def test_a_pod_that_calls_itself_the_operator_elsewhere_is_a_stranger() -> None:
    objects = rendered(*ON)
    forged = Pod("lanes", operator_of(objects).labels)
    assert not allowed(of_kind(objects, "NetworkPolicy"), forged, HERE["driver"], PROGRESS)


@pytest.mark.parametrize("target", ["operator", "driver"])
def test_prometheus_reads_metrics_where_it_is_named(target: str) -> None:
    objects = rendered(*ON, f"networkPolicy.metricsFrom={json.dumps([MONITORING])}")
    policies = of_kind(objects, "NetworkPolicy")
    pod = operator_of(objects) if target == "operator" else HERE["driver"]
    prometheus = Pod("monitoring", (("app", "prometheus"),))
    assert allowed(policies, prometheus, pod, PROGRESS)
    assert not allowed(policies, prometheus, pod, SPARK_PORT)
    assert not allowed(policies, prometheus, HERE["executor"], PROGRESS)


def test_prometheus_reads_the_agents_of_as_many_images_as_a_job_may_have_and_nothing_else() -> None:
    objects = rendered(*ON, f"networkPolicy.metricsFrom={json.dumps([MONITORING])}")
    policies, executor = of_kind(objects, "NetworkPolicy"), HERE["executor"]
    prometheus = Pod("monitoring", (("app", "prometheus"),))
    most = yaml.load((ROOT / "crds/simulationjobs.yaml").read_text(), Loader=yaml.CSafeLoader)
    schema = most["spec"]["versions"][0]["schema"]["openAPIV3Schema"]["properties"]["spec"]
    images = schema["properties"]["variants"]["maxItems"]
    ways = range(AGENT - 1, AGENT + images + 1)
    open_ways = [port for port in ways if allowed(policies, prometheus, executor, port)]
    assert open_ways == list(range(AGENT, AGENT + images))
    for port in (SPARK_PORT, ROS_MASTER):
        assert not allowed(policies, prometheus, executor, port)
    assert not allowed(policies, STRANGER, executor, AGENT)
