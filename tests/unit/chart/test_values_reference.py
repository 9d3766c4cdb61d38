"""docs/reference/chart-values.md is what values.yaml and its schema say."""

import json
import re

import pytest
import yaml

from charts import reference

SCHEMA = json.loads((reference.CHART / "values.schema.json").read_text())
SOURCE = (reference.CHART / "values.yaml").read_text()


def test_the_page_is_current() -> None:
    assert reference.PAGE.read_text() == reference.page(), "run charts/reference.py"


def test_every_value_is_on_it_with_its_default() -> None:
    found = list(reference.values(SOURCE))
    leaves = [value for value in found if not value.group]
    assert (len(found), len(leaves)) == (58, 42)
    headings = re.findall(r"^##+ `(.*)`$", reference.page(), re.MULTILINE)
    assert headings == [value.path for value in found]
    for value in leaves:
        default = yaml.safe_load(SOURCE)
        for name in value.path.split("."):
            default = default[name]
        assert yaml.safe_load(value.default) == default


def test_a_value_says_what_it_may_be() -> None:
    def said(path: str) -> str:
        return reference.facts(reference.schema_at(SCHEMA, path), SCHEMA)

    assert said("operator.replicas") == "integer, 0 to 5"
    assert said("operator.stuckSeconds") == "number, above 0"
    assert said("images.pullPolicy") == "one of `Always`, `IfNotPresent`, `Never`"
    assert said("jobNamespaces") == "list of strings"
    assert said("dashboards.labels") == "map"


def test_a_value_without_a_word_or_a_schema_is_refused() -> None:
    with pytest.raises(SystemExit, match=r"line 3: say above a.c what it is"):
        list(reference.values("# A.\na: \n  c: 1\n"))
    with pytest.raises(SystemExit, match=r"operator.colour: add it to values.schema.json"):
        reference.schema_at(SCHEMA, "operator.colour")
