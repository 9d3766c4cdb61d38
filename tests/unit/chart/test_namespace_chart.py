"""The chart bagpipe-namespace gives a namespace what jobNamespaces of the main chart gives it."""

import json
from pathlib import Path

import pytest
import yaml

from tests.unit.chart.test_chart import CHART, Object, helm, rendered

NAMESPACE_CHART = CHART.parent / "bagpipe-namespace"
GIVEN = {
    "serviceAccounts": {
        "imagePullSecrets": [{"name": "login"}],
        "driver": {"annotations": {"a": "b"}},
        "executor": {"annotations": {"c": "d"}},
    },
    "networkPolicy": {"enabled": True, "metricsFrom": [{"podSelector": {}}]},
}


def of_its_own_chart(chart: Path, *values: str) -> list[Object]:
    settings = [word for value in values for word in ("--set-json", value)]
    where = ["--namespace", "lanes", "--kube-version", "1.34.4"]
    answer = helm("template", "bagpipe-namespace", str(chart), *where, *settings)
    assert answer.returncode == 0, answer.stderr
    return [o for o in yaml.load_all(answer.stdout, Loader=yaml.CSafeLoader) if o]


def of_the_main_chart(*values: str) -> list[Object]:
    jobs = ['jobNamespaces=["lanes"]', 'watchNamespaces=["lanes","maps"]']
    found = [o for o in rendered(*jobs, *values) if o["metadata"].get("namespace") == "lanes"]
    # The operator's own rights there are its release's affair, as is what `helm test` needs.
    return [o for o in found if o["metadata"]["name"].startswith("bagpipe-driver")
            or o["metadata"]["name"].startswith("bagpipe-executor")]  # fmt: skip


def without_labels(objects: list[Object]) -> dict[str, Object]:
    found = {}
    for obj in objects:
        del obj["metadata"]["labels"]
        found[f"{obj['kind']}/{obj['metadata']['name']}"] = obj
    return found


@pytest.mark.parametrize("values", [{}, GIVEN], ids=["by default", "all values"])
def test_both_charts_make_the_same_of_a_namespace(values: Object) -> None:
    given = [f"{name}={json.dumps(value)}" for name, value in values.items()]
    ours = without_labels(of_its_own_chart(NAMESPACE_CHART, *given))
    assert len(ours) == (6 if values else 4)
    assert ours == without_labels(of_the_main_chart(*given))


def test_a_package_of_it_is_whole(tmp_path: Path) -> None:
    """It links to a template of the other chart, which lies elsewhere by then."""
    packed = helm("package", str(NAMESPACE_CHART), "--destination", str(tmp_path))
    assert packed.returncode == 0, packed.stderr
    (archive,) = tmp_path.glob("bagpipe-namespace-*.tgz")
    assert of_its_own_chart(archive) == of_its_own_chart(NAMESPACE_CHART)
