"""The table of refusals, by the schema's reader in place of an API server."""

import pytest
import yaml

from tests.crds.table import Row, refused, taken
from tests.unit.crds.offline import Schema, refusals
from tests.unit.crds.test_crd import CRD, schema_of

# What the API server adds to every schema.
ANY: Schema = {"type": "object"}
TEXT: Schema = {"type": "string"}
# In refusals that the API server words by itself; all others are sentences of our rules.
KUBERNETES = (
    "Duplicate value",
    "Required",
    "Unsupported value",
    "must be of type",
    "must not validate",
    "should be a multiple",
    "should be greater than",
    "should be less than",
    "must have at most",
    "should match",
    "supported values",
    "unknown field",
)


@pytest.fixture(scope="module")
def schema() -> Schema:
    known = schema_of(yaml.load(CRD.read_text(), Loader=yaml.CSafeLoader))
    added = {"apiVersion": TEXT, "kind": TEXT, "metadata": ANY}
    return known | {"properties": known["properties"] | added}


@pytest.mark.parametrize("row", taken(), ids=str)
def test_a_good_job_is_taken(row: Row, schema: Schema) -> None:
    assert refusals(schema, row.manifest) == []


@pytest.mark.parametrize("row", refused(), ids=str)
def test_a_bad_job_is_refused_by_the_rule_that_says_so(row: Row, schema: Schema) -> None:
    messages = refusals(schema, row.manifest)
    assert messages
    if not any(words in row.says for words in KUBERNETES):
        assert any(row.says in sentence for sentence in messages), messages
