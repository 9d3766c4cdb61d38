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

Object = dict[str, Any]

ROOT = Path(__file__).parents[3]
CHART = ROOT / "charts" / "bagpipe"
SNAPSHOT = Path(__file__).parent / "rendered.yaml"
HELM_SECONDS = 60

CACHE = Path(os.environ.get("BAGPIPE_CACHE", Path.home() / ".cache/bagpipe"))
# Ours where the machine has none that is new enough; `make tools` decides.
HELM = shutil.which("helm", path=f"{CACHE / 'bin/tools'}:{os.environ['PATH']}")


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
    return [o for o in yaml.safe_load_all(answer.stdout) if o]


def of_kind(objects: list[Object], kind: str) -> list[Object]:
    return [o for o in objects if o["kind"] == kind]


def rules(role: Object) -> set[tuple[str, str]]:
    return {
        (resource, verb)
        for rule in role["rules"]
        for resource in rule["resources"]
        for verb in rule["verbs"]
    }


OPERATOR_RIGHTS = {
    ("simulationjobs", "get"),
    ("simulationjobs", "list"),
    ("simulationjobs", "watch"),
    ("simulationjobs/status", "patch"),
    ("pods", "get"),
    ("pods", "list"),
    ("pods", "watch"),
    ("pods", "create"),
    ("pods", "delete"),
    ("configmaps", "get"),
    ("configmaps", "create"),
    ("events", "create"),
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


def test_the_crd_is_the_one_source() -> None:
    (crd,) = of_kind(rendered(), "CustomResourceDefinition")
    assert crd == yaml.safe_load((ROOT / "crds" / "simulationjobs.yaml").read_text())
    assert crd["metadata"]["annotations"]["helm.sh/resource-policy"] == "keep"
    assert of_kind(rendered('crds={"install":false}'), "CustomResourceDefinition") == []


def test_the_operator_may_do_what_it_does_and_no_more() -> None:
    objects = rendered()
    (role,) = of_kind(objects, "ClusterRole")
    assert rules(role) == OPERATOR_RIGHTS
    assert len(of_kind(objects, "ClusterRoleBinding")) == 1


def test_named_namespaces_need_no_cluster_wide_right() -> None:
    objects = rendered('watchNamespaces=["lanes","maps"]')
    assert of_kind(objects, "ClusterRole") == of_kind(objects, "ClusterRoleBinding") == []
    roles = [r for r in of_kind(objects, "Role") if r["metadata"]["name"] != "bagpipe-driver"]
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
    roles = of_kind(objects, "Role")
    assert [r["metadata"]["namespace"] for r in roles] == ["lanes", "maps"]
    assert all(rules(role) == DRIVER_RIGHTS for role in roles)
    bindings = of_kind(objects, "RoleBinding")
    assert all(b["subjects"][0]["namespace"] == b["metadata"]["namespace"] for b in bindings)


def test_the_images() -> None:
    (deployment,) = of_kind(
        rendered('images.registry="r.example/b"', 'images.tag="7"'), "Deployment"
    )
    container = deployment["spec"]["template"]["spec"]["containers"][0]
    environment = {e["name"]: e["value"] for e in container["env"]}
    assert container["image"] == "r.example/b/operator:7"
    assert environment["BAGPIPE_SPARK_IMAGE"] == "r.example/b/spark:7"
    assert environment["BAGPIPE_AGENT_IMAGE"] == "r.example/b/agent:7"


REFUSED = {
    "a misspelt value": ('watchNamespace=["a"]', "'watchNamespace' not allowed"),
    "a namespace's name": ('jobNamespaces=["Lanes"]', "does not match pattern"),
    "a pull policy": ('images.pullPolicy="Sometimes"', "value must be one of"),
    "no patience": ("operator.stuckSeconds=0", "exclusiveMinimum"),
    "no workers": ("operator.workers=0", "minimum"),
}


@pytest.mark.parametrize("case", REFUSED)
def test_wrong_values_are_refused(case: str) -> None:
    value, sentence = REFUSED[case]
    answer = template(value)
    assert answer.returncode != 0
    assert sentence in answer.stderr or sentence.replace("Minimum", " minimum") in answer.stderr


def test_every_value_is_commented_and_has_a_schema() -> None:
    lines = (CHART / "values.yaml").read_text().splitlines()
    keys = [n for n, line in enumerate(lines) if re.match(r"^ {0,2}[a-zA-Z]+:", line)]
    bare = [lines[n].strip() for n in keys if not lines[n - 1].strip().startswith("#")]
    assert bare == []
    schema = json.loads((CHART / "values.schema.json").read_text())
    values = yaml.safe_load("\n".join(lines))
    assert set(values) == set(schema["properties"]) - {"global"}
    for section in ("images", "crds", "operator"):
        assert set(values[section]) == set(schema["properties"][section]["properties"])
