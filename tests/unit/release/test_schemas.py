"""The JSON Schemas take every manifest of the examples, and name what is wrong with another."""

from __future__ import annotations

import copy
import json
from pathlib import Path
from typing import Any

import jsonschema
import pytest
import yaml

from release import schemas

ROOT = Path(__file__).parents[3]
KINDS = {"SimulationJob": "simulationjob", "SimulationSchedule": "simulationschedule"}
MANIFESTS = [
    (path, manifest)
    for path in sorted((ROOT / "docs/examples").rglob("*.yaml"))
    for manifest in yaml.load_all(path.read_text(), Loader=yaml.CSafeLoader)
    if manifest and manifest.get("kind") in KINDS
]


@pytest.fixture(scope="module")
def written(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Any]:
    """The schemas as editors read them, by the name of their kind."""
    paths = schemas.write(tmp_path_factory.mktemp("schemas"))
    assert [p.name for p in paths] == [
        "simulationjob-v1alpha1.json",
        "simulationschedule-v1alpha1.json",
    ]
    return {path.name.partition("-")[0]: json.loads(path.read_text()) for path in paths}


def faults(schema: Any, manifest: Any) -> list[tuple[str, str]]:
    """Where a manifest is wrong, and by which word of the schema."""
    jsonschema.Draft7Validator.check_schema(schema)
    found = jsonschema.Draft7Validator(schema).iter_errors(manifest)
    return sorted((error.json_path, str(error.validator)) for error in found)


@pytest.mark.parametrize(
    ("path", "manifest"), MANIFESTS, ids=lambda value: getattr(value, "name", "")
)
def test_every_example_is_valid(path: Path, manifest: Any, written: dict[str, Any]) -> None:
    assert faults(written[KINDS[manifest["kind"]]], manifest) == [], path


def test_there_are_examples_of_both_kinds() -> None:
    kinds = [manifest["kind"] for _, manifest in MANIFESTS]
    assert kinds.count("SimulationJob") >= 10
    assert kinds.count("SimulationSchedule") >= 1


JOB = yaml.safe_load((ROOT / "docs/examples/robot-state-publisher/job.yaml").read_text())


@pytest.mark.parametrize(
    ("path", "value", "where", "word"),
    [
        (("spec", "playbck"), {}, "$.spec", "additionalProperties"),
        (("spec", "spark", "executors"), "two", "$.spec.spark.executors", "pattern"),
        (("spec", "stack", "engine"), "ros3", "$.spec.stack.engine", "enum"),
        (("kind",), "SimulationSchedule", "$.kind", "const"),
        (("apiVersion",), "sim.bagpipe.io/v1", "$.apiVersion", "const"),
        (("spec", "output"), None, "$.spec.output", "type"),
    ],
)
def test_what_is_wrong_is_named(
    path: tuple[str, ...], value: Any, where: str, word: str, written: dict[str, Any]
) -> None:
    manifest = copy.deepcopy(JOB)
    *parents, last = path
    place = manifest
    for key in parents:
        place = place.setdefault(key, {})
    place[last] = value
    assert faults(written["simulationjob"], manifest) == [(where, word)]


def test_what_the_api_keeps_open_stays_open(written: dict[str, Any]) -> None:
    manifest = copy.deepcopy(JOB)
    manifest["metadata"] |= {"labels": {"a": "b"}, "ownerReferences": []}
    manifest["spec"]["stack"]["parameters"] = {"/a": [1, {"b": None}], "/c": 1.5}
    manifest["spec"]["stack"]["resources"] = {"limits": {"cpu": 2, "memory": "1Gi"}}
    assert faults(written["simulationjob"], manifest) == []


def test_a_bound_that_is_not_reached_is_json_schema_s() -> None:
    bounds = {"type": "number", "minimum": 0, "exclusiveMinimum": True}
    schema = schemas.closed({"type": "object", "properties": {"rate": bounds}})
    assert faults(schema, {"rate": 0}) == [("$.rate", "exclusiveMinimum")]
    assert faults(schema, {"rate": 0.5}) == []
