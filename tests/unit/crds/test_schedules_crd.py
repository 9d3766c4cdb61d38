"""The CRD of schedules: what a person wrote of it, and the job's spec that is put into it."""

import json
from datetime import UTC, datetime
from typing import Any

import pytest
import yaml

from bagpipe_operator.api import readings
from bagpipe_operator.api.runs import PassedRun
from tests.unit.crds.test_crd import CRD, ROOT, schema_of, walk

Schema = dict[str, Any]

SCHEDULES = ROOT / "crds" / "simulationschedules.yaml"


@pytest.fixture(scope="module")
def crd() -> Schema:
    loaded: Schema = yaml.load(SCHEDULES.read_text(), Loader=yaml.CSafeLoader)
    return loaded


@pytest.fixture(scope="module")
def spec(crd: Schema) -> Schema:
    found: Schema = schema_of(crd)["properties"]["spec"]
    return found


def rules(schema: Schema) -> list[Schema]:
    return [r for _, s in walk(schema) for r in s.get("x-kubernetes-validations", [])]


def test_it_is_small_enough_for_kubectl_apply() -> None:
    # kubectl keeps the whole object, as JSON, in an annotation of at most 262,144 bytes.
    assert len(json.dumps(yaml.load(SCHEDULES.read_text(), Loader=yaml.CSafeLoader))) < 200_000


def test_every_field_is_described_in_sentences(crd: Schema) -> None:
    descriptions = {path: s.get("description", "") for path, s in walk(schema_of(crd))}
    loose = [p for p, text in descriptions.items() if not text.endswith(".") and p != ".metadata"]
    assert loose == []


def test_every_list_text_and_map_of_the_spec_is_bounded(spec: Schema) -> None:
    own = {p: s for p, s in walk(spec) if not p.startswith(".jobTemplate.spec")}
    bounds = {"array": "maxItems", "string": "maxLength"}
    unbounded = [
        path
        for path, s in own.items()
        if (s.get("type") in bounds and bounds[s["type"]] not in s and "enum" not in s)
        or ("additionalProperties" in s and "maxProperties" not in s)
    ]
    assert unbounded == []


def test_what_the_operator_reads_of_a_status_is_a_field_of_one() -> None:
    # The API server drops what its CRD does not have, without a word.
    crds = [
        schema_of(yaml.load(each.read_text(), Loader=yaml.CSafeLoader)) for each in (CRD, SCHEDULES)
    ]
    kept = {field for crd in crds for field in crd["properties"]["status"]["properties"]}
    assert set(readings.STATUS_FIELDS) - kept == set()


def test_the_run_that_passed_is_kept_whole(crd: Schema) -> None:
    run = PassedRun(datetime(2026, 11, 17, 2, 30, tzinfo=UTC), "n-1", "pvc://r/n-1").as_status()
    status = schema_of(crd)["properties"]["status"]["properties"]
    assert set(run) == set(status["lastPassed"]["properties"])


def test_a_template_has_the_fields_of_a_job(spec: Schema) -> None:
    job = schema_of(yaml.load(CRD.read_text(), Loader=yaml.CSafeLoader))["properties"]["spec"]
    template = spec["properties"]["jobTemplate"]["properties"]["spec"]
    assert [p for p, _ in walk(template)] == [p for p, _ in walk(job)]
    assert template["required"] == job["required"]


def test_a_template_has_the_rules_of_a_job_but_those_against_changes(spec: Schema) -> None:
    job = schema_of(yaml.load(CRD.read_text(), Loader=yaml.CSafeLoader))["properties"]["spec"]
    template = spec["properties"]["jobTemplate"]["properties"]["spec"]
    lasting = [rule for rule in rules(job) if "oldSelf" not in rule["rule"]]
    assert rules(template) == lasting
    assert len(rules(job)) > len(lasting) > 40


def test_the_rules_of_its_own_say_what_to_write(crd: Schema) -> None:
    own = [p for p in walk(schema_of(crd)) if not p[0].startswith(".spec.jobTemplate.spec")]
    messages = [r["message"] for _, s in own for r in s.get("x-kubernetes-validations", [])]
    assert len(messages) == 5
    assert [m for m in messages if "write " not in m] == []


def test_names_columns_and_defaults(crd: Schema, spec: Schema) -> None:
    names, version = crd["spec"]["names"], crd["spec"]["versions"][0]
    assert (names["kind"], names["plural"], names["shortNames"]) == (
        "SimulationSchedule",
        "simulationschedules",
        ["simschedule"],
    )
    assert (version["name"], version["subresources"]) == ("v1alpha1", {"status": {}})
    columns = version["additionalPrinterColumns"]
    assert [c["name"] for c in columns if not c.get("priority")] == [
        "Schedule", "Suspend", "Active", "Last", "Next", "Age",
    ]  # fmt: skip
    defaults = {n: f["default"] for n, f in spec["properties"].items() if "default" in f}
    assert defaults == {
        "timeZone": "Etc/UTC",
        "concurrencyPolicy": "Allow",
        "suspend": False,
        "successfulJobsHistoryLimit": 3,
        "failedJobsHistoryLimit": 1,
    }
