"""The chart as Helm renders it: a snapshot, rights, and values that are refused.

Helm renders without a cluster; where the machine has no helm, tests/cluster builds one.
"""

import json
import os
import re
import shutil
import subprocess
from pathlib import Path
from typing import Any

import pytest
import yaml

from tests.cached import cache

Object = dict[str, Any]

ROOT = Path(__file__).parents[3]
CHART = ROOT / "charts" / "bagpipe"
SNAPSHOT = Path(__file__).parent / "rendered.yaml"
HELM_SECONDS = 60

# Ours where the machine has none that is new enough; `make tools` decides.
HELM = shutil.which("helm", path=f"{cache() / 'bin/tools'}:{os.environ['PATH']}")


def helm(*words: str) -> subprocess.CompletedProcess[str]:
    assert HELM is not None, "no helm: python3 tests/cluster/cluster.py tools builds one"
    return subprocess.run(
        [HELM, *words], capture_output=True, text=True, timeout=HELM_SECONDS, check=False
    )


def template(*values: str) -> subprocess.CompletedProcess[str]:
    settings = [word for value in values for word in ("--set-json", value)]
    where = ["--namespace", "bagpipe-system", "--kube-version", "1.34.4"]
    return helm("template", "bagpipe", str(CHART), *where, *settings)


def rendered(*values: str) -> list[Object]:
    answer = template(*values)
    assert answer.returncode == 0, answer.stderr
    return [o for o in yaml.load_all(answer.stdout, Loader=yaml.CSafeLoader) if o]


def of_kind(objects: list[Object], kind: str) -> list[Object]:
    """The objects of a kind that stay: those of `helm test` come and go with it."""
    return [o for o in objects if o["kind"] == kind and not _of_helm_test(o)]


def cluster_roles(objects: list[Object]) -> list[Object]:
    """The ClusterRoles that are for accounts of the chart, not for people."""
    return [r for r in of_kind(objects, "ClusterRole") if r["metadata"]["name"] not in USER_ROLES]


def _of_helm_test(obj: Object) -> bool:
    return "helm.sh/hook" in (obj["metadata"].get("annotations") or {})


def rules(role: Object) -> set[tuple[str, str]]:
    return {
        (resource, verb)
        for rule in role["rules"]
        for resource in rule["resources"]
        for verb in rule["verbs"]
    }


USER_ROLES = ("bagpipe-view", "bagpipe-edit")
OPERATOR_RIGHTS = {
    ("simulationjobs", "get"),
    ("simulationjobs", "list"),
    ("simulationjobs", "watch"),
    ("simulationjobs", "delete"),
    ("simulationjobs/status", "patch"),
    ("simulationjobs", "create"),
    ("simulationjobs", "delete"),
    ("simulationschedules", "get"),
    ("simulationschedules", "list"),
    ("simulationschedules", "watch"),
    ("simulationschedules/status", "patch"),
    ("pods", "get"),
    ("pods", "list"),
    ("pods", "watch"),
    ("pods", "create"),
    ("pods", "delete"),
    ("configmaps", "get"),
    ("configmaps", "create"),
    ("events", "create"),
    ("events", "list"),
    ("persistentvolumeclaims", "get"),
}
DRIVER_RIGHTS = {
    ("pods", verb) for verb in ("get", "list", "watch", "create", "delete", "deletecollection")
}


def test_lint() -> None:
    answer = helm("lint", "--strict", str(CHART))
    assert answer.returncode == 0, answer.stdout + answer.stderr


def test_the_rendered_chart_is_the_one_that_was_reviewed() -> None:
    """After an intended change: UPDATE_SNAPSHOTS=1 pytest tests/unit/chart, and read the diff."""
    objects = [o for o in rendered() if o["kind"] != "CustomResourceDefinition"]
    text = yaml.safe_dump_all(objects, sort_keys=False)
    if os.environ.get("UPDATE_SNAPSHOTS"):
        SNAPSHOT.write_text(text)
    assert SNAPSHOT.read_text() == text


def test_the_crds_are_the_one_source() -> None:
    crds = of_kind(rendered(), "CustomResourceDefinition")
    sources = ["simulationjobs.yaml", "simulationschedules.yaml"]
    assert crds == [
        yaml.load((ROOT / "crds" / source).read_text(), Loader=yaml.CSafeLoader)
        for source in sources
    ]
    kept = [crd["metadata"]["annotations"]["helm.sh/resource-policy"] for crd in crds]
    assert kept == ["keep", "keep"]
    assert of_kind(rendered('crds={"install":false}'), "CustomResourceDefinition") == []


def test_the_whole_cluster_is_asked_for() -> None:
    objects = rendered("clusterWide=true")
    (role,) = cluster_roles(objects)
    assert rules(role) == OPERATOR_RIGHTS
    assert len(of_kind(objects, "ClusterRoleBinding")) == 1


@pytest.mark.parametrize(
    "values",
    [
        ['watchNamespaces=["lanes","maps"]', 'jobNamespaces=["lanes"]'],
        ['jobNamespaces=["lanes","maps"]'],
    ],
)
def test_without_it_the_operator_has_rights_where_it_watches_and_no_more(values: list[str]) -> None:
    objects = rendered(*values)
    assert cluster_roles(objects) == of_kind(objects, "ClusterRoleBinding") == []
    (account,) = {o["metadata"]["name"] for o in of_kind(objects, "Deployment")}
    roles = [r for r in of_kind(objects, "Role") if r["metadata"]["name"].endswith(account)]
    assert {r["metadata"]["namespace"] for r in roles} == {"lanes", "maps"}
    assert all(rules(role) == OPERATOR_RIGHTS for role in roles)
    (deployment,) = of_kind(objects, "Deployment")
    container = deployment["spec"]["template"]["spec"]["containers"][0]
    environment = {e["name"]: e["value"] for e in container["env"]}
    assert environment["BAGPIPE_WATCH_NAMESPACES"] == "lanes,maps"


def test_every_job_namespace_gets_a_driver_account_with_just_pods() -> None:
    objects = rendered('jobNamespaces=["lanes","maps"]')
    accounts = [o for o in of_kind(objects, "ServiceAccount") if "driver" in o["metadata"]["name"]]
    assert [a["metadata"]["namespace"] for a in accounts] == ["lanes", "maps"]
    roles = [r for r in of_kind(objects, "Role") if r["metadata"]["name"] == "bagpipe-driver"]
    assert [r["metadata"]["namespace"] for r in roles] == ["lanes", "maps"]
    assert all(rules(role) == DRIVER_RIGHTS for role in roles)
    bindings = [
        b for b in of_kind(objects, "RoleBinding") if b["metadata"]["name"] == "bagpipe-driver"
    ]
    assert len(bindings) == 2
    assert all(b["subjects"][0]["namespace"] == b["metadata"]["namespace"] for b in bindings)


def test_executors_have_an_account_without_rights_in_every_job_namespace() -> None:
    notes = {"eks.amazonaws.com/role-arn": "arn:aws:iam::111122223333:role/recordings"}
    values = json.dumps({"driver": {"annotations": {"a": "b"}}, "executor": {"annotations": notes}})
    objects = rendered('jobNamespaces=["lanes","maps"]', f"serviceAccounts={values}")
    accounts = {
        (o["metadata"]["name"], o["metadata"]["namespace"]): o
        for o in of_kind(objects, "ServiceAccount")
    }
    for namespace in ("lanes", "maps"):
        executor = accounts["bagpipe-executor", namespace]
        assert executor["automountServiceAccountToken"] is False
        assert executor["metadata"]["annotations"] == notes
        assert accounts["bagpipe-driver", namespace]["metadata"]["annotations"] == {"a": "b"}
    subjects = [s["name"] for o in of_kind(objects, "RoleBinding") for s in o["subjects"]]
    assert "bagpipe-executor" not in subjects


def test_the_lease_is_the_releases_own_and_no_other() -> None:
    objects = rendered()
    (role,) = [r for r in of_kind(objects, "Role") if r["metadata"]["name"].endswith("-lease")]
    (deployment,) = of_kind(objects, "Deployment")
    container = deployment["spec"]["template"]["spec"]["containers"][0]
    environment = {e["name"]: e["value"] for e in container["env"]}
    assert role["metadata"]["namespace"] == environment["BAGPIPE_LEASE_NAMESPACE"]
    named, making = role["rules"]
    assert named["resourceNames"] == [environment["BAGPIPE_LEASE_NAME"]]
    assert (named["verbs"], making["verbs"]) == (["get", "update"], ["create"])
    assert named["resources"] == making["resources"] == ["leases"]


@pytest.mark.parametrize(("replicas", "budgets"), [(1, 0), (2, 1)])
def test_replicas(replicas: int, budgets: int) -> None:
    objects = rendered(f"operator.replicas={replicas}")
    (deployment,) = of_kind(objects, "Deployment")
    assert deployment["spec"]["replicas"] == replicas
    assert deployment["spec"]["strategy"]["type"] == "RollingUpdate"
    labels = deployment["spec"]["template"]["metadata"]["labels"]
    found = of_kind(objects, "PodDisruptionBudget")
    assert len(found) == budgets
    for budget in found:
        assert budget["spec"]["maxUnavailable"] == 1
        assert budget["spec"]["selector"]["matchLabels"].items() <= labels.items()
    (wish,) = deployment["spec"]["template"]["spec"]["affinity"]["podAntiAffinity"].values()
    term = wish[0]["podAffinityTerm"]
    assert term["labelSelector"]["matchLabels"].items() <= labels.items()


def test_an_affinity_takes_the_place_of_the_charts_own() -> None:
    mine: Object = {"nodeAffinity": {"preferredDuringSchedulingIgnoredDuringExecution": []}}
    (deployment,) = of_kind(rendered(f"operator.affinity={json.dumps(mine)}"), "Deployment")
    assert deployment["spec"]["template"]["spec"]["affinity"] == mine


def test_no_token_is_mounted_by_itself_but_the_operator_s() -> None:
    objects = rendered()
    accounts = of_kind(objects, "ServiceAccount")
    assert [a["automountServiceAccountToken"] for a in accounts] == [False] * 3
    (deployment,) = of_kind(objects, "Deployment")
    assert deployment["spec"]["template"]["spec"]["automountServiceAccountToken"] is True


def test_the_operator_s_pod_meets_the_level_restricted() -> None:
    (deployment,) = of_kind(rendered(), "Deployment")
    spec = deployment["spec"]["template"]["spec"]
    assert spec["securityContext"]["runAsNonRoot"] is True
    (container,) = spec["containers"]
    assert container["securityContext"] == {
        "allowPrivilegeEscalation": False,
        "readOnlyRootFilesystem": True,
        "runAsNonRoot": True,
        "capabilities": {"drop": ["ALL"]},
        "seccompProfile": {"type": "RuntimeDefault"},
    }


def test_the_images() -> None:
    (deployment,) = of_kind(
        rendered('images.registry="r.example/b"', 'images.tag="7"'), "Deployment"
    )
    container = deployment["spec"]["template"]["spec"]["containers"][0]
    environment = {e["name"]: e["value"] for e in container["env"]}
    assert container["image"] == "r.example/b/operator:7"
    assert environment["BAGPIPE_SPARK_IMAGE"] == "r.example/b/spark:7"
    assert environment["BAGPIPE_AGENT_IMAGE"] == "r.example/b/agent:7"


@pytest.mark.parametrize("slash", ["", "/"])
def test_whoever_is_paged_gets_a_link(slash: str) -> None:
    where = "https://wiki.example.com/alerts"
    made = rendered("alerts.prometheusRule.enabled=true", f'alerts.runbooks="{where}{slash}"')
    (rule,) = of_kind(made, "PrometheusRule")
    found = {r["alert"]: r["annotations"] for g in rule["spec"]["groups"] for r in g["rules"]}
    assert len(found) > 20
    for alert, annotations in found.items():
        assert annotations["runbook_url"] == f"{where}/{alert}.md"
        assert "runbook" not in annotations


REFUSED = {
    "a misspelt value": ('watchNamespace=["a"]', "'watchNamespace' not allowed"),
    "a namespace's name": ('jobNamespaces=["Lanes"]', "does not match pattern"),
    "a pull policy": ('images.pullPolicy="Sometimes"', "value must be one of"),
    "no patience": ("operator.stuckSeconds=0", "exclusiveMinimum"),
    "no workers": ("operator.workers=0", "minimum"),
    "a page without an address": ('alerts.runbooks="docs/operations"', "does not match pattern"),
    "a short lease": ("operator.leaseSeconds=2", "minimum"),
    "jobs beside the operator": ('jobNamespaces=["bagpipe-system"]', "in a namespace of its own"),
    "everything and a namespace": (
        'clusterWide=true,watchNamespaces=["default"]',
        "leave one of them out",
    ),
    "nothing to watch": ("jobNamespaces=[]", "the operator has nothing to watch"),
    "jobs that nobody watches": ('watchNamespaces=["lanes"]', "jobNamespaces names default"),
}


@pytest.mark.parametrize("case", REFUSED)
def test_wrong_values_are_refused(case: str) -> None:
    value, sentence = REFUSED[case]
    answer = template(value)
    assert answer.returncode != 0
    assert sentence in answer.stderr or sentence.replace("Minimum", " minimum") in answer.stderr


def test_a_watching_release_may_leave_accounts_to_others() -> None:
    objects = rendered('watchNamespaces=["lanes"]', "jobNamespaces=[]")
    accounts = [o["metadata"]["name"] for o in of_kind(objects, "ServiceAccount")]
    assert accounts == ["bagpipe-operator"]


def test_every_value_is_commented_and_has_a_schema() -> None:
    lines = (CHART / "values.yaml").read_text().splitlines()
    keys = [n for n, line in enumerate(lines) if re.match(r"^ {0,2}[a-zA-Z]+:", line)]
    bare = [lines[n].strip() for n in keys if not lines[n - 1].strip().startswith("#")]
    assert bare == []
    schema = json.loads((CHART / "values.schema.json").read_text())
    values = yaml.safe_load("\n".join(lines))
    assert set(values) == set(schema["properties"]) - {"global"}
    sections = {name: value for name, value in values.items() if isinstance(value, dict)}
    for name, section in sections.items():
        assert set(section) == set(schema["properties"][name]["properties"]), name
