"""The pages of the charts' values are what values.yaml and its schema say."""

import json
import re

import pytest
import yaml

from charts import reference

SCHEMA = json.loads((reference.BAGPIPE.folder / "values.schema.json").read_text())


def source(chart: reference.Chart) -> str:
    return (chart.folder / "values.yaml").read_text()


@pytest.mark.parametrize("chart", reference.CHARTS, ids=lambda chart: chart.name)
def test_the_page_is_current(chart: reference.Chart) -> None:
    assert chart.page.read_text() == reference.page(chart), "run charts/reference.py"


@pytest.mark.parametrize(
    ("chart", "count"), [(reference.BAGPIPE, (86, 64)), (reference.NAMESPACE, (16, 9))]
)
def test_every_value_is_on_it_with_its_default(
    chart: reference.Chart, count: tuple[int, int]
) -> None:
    found = list(reference.values(source(chart)))
    leaves = [value for value in found if not value.group]
    assert (len(found), len(leaves)) == count
    headings = re.findall(r"^##+ `(.*)`$", reference.page(chart), re.MULTILINE)
    assert headings == [value.path for value in found]
    for value in leaves:
        default = yaml.safe_load(source(chart))
        for name in value.path.split("."):
            default = default[name]
        assert yaml.safe_load(value.default) == default


def test_a_value_says_what_it_may_be() -> None:
    def facts(path: str) -> str:
        return reference.facts(reference.schema_at(SCHEMA, path), SCHEMA)

    assert facts("operator.replicas") == "integer, 0 to 5"
    assert facts("operator.stuckSeconds") == "number, above 0"
    assert facts("images.pullPolicy") == "one of `Always`, `IfNotPresent`, `Never`"
    assert facts("jobNamespaces") == "list of strings"
    assert facts("dashboards.labels") == "map"


def test_a_value_without_a_word_or_a_schema_is_refused() -> None:
    with pytest.raises(SystemExit, match=r"line 3: say above a.c what it is"):
        list(reference.values("# A.\na: \n  c: 1\n"))
    with pytest.raises(SystemExit, match=r"operator.colour: add it to values.schema.json"):
        reference.schema_at(SCHEMA, "operator.colour")
