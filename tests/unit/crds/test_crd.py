"""The CRD as a file: size, descriptions, bounds, and what is derived from it."""

import importlib.util
import json
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
import yaml

from bagpipe.source_spec import Source, source_model
from bagpipe.spec import SimulationJobSpec
from bagpipe_operator.jobs.pods import job_config

Schema = dict[str, Any]

ROOT = Path(__file__).parents[3]
CRD = ROOT / "crds" / "simulationjobs.yaml"
# kubectl keeps what it sent in an annotation of at most 262,144 bytes: this leaves 112 KiB of it.
LARGEST_BYTES = 147_456


@pytest.fixture(scope="module")
def crd() -> Schema:
    loaded: Schema = yaml.load(CRD.read_text(), Loader=yaml.CSafeLoader)
    return loaded


def schema_of(crd: Schema) -> Schema:
    schema: Schema = crd["spec"]["versions"][0]["schema"]["openAPIV3Schema"]
    return schema


def walk(schema: Schema, path: str = "") -> Iterator[tuple[str, Schema]]:
    yield path, schema
    for name, below in (schema.get("properties") or {}).items():
        yield from walk(below, f"{path}.{name}")
    for key in ("items", "additionalProperties"):
        if isinstance(schema.get(key), dict):
            yield from walk(schema[key], f"{path}[]")


def test_it_is_small_enough_for_kubectl_apply(crd: Schema) -> None:
    # The file names some parts once and uses them twice; the API server gets them twice.
    sent = len(json.dumps(crd))
    assert sent < LARGEST_BYTES, sent


class GoLoader(yaml.SafeLoader):
    """YAML as kubectl and Helm read it: a bare y or n is a boolean, unlike PyYAML's."""


GoLoader.add_implicit_resolver("tag:yaml.org,2002:bool", re.compile("^[yYnN]$"), list("yYnN"))
GoLoader.bool_values = yaml.SafeLoader.bool_values | {"y": True, "n": False}


@pytest.mark.parametrize("path", sorted((ROOT / "crds").glob("*.yaml")), ids=lambda path: path.stem)
def test_kubectl_and_helm_read_the_same_as_python(path: Path) -> None:
    text = path.read_text()
    assert yaml.load(text, GoLoader) == yaml.safe_load(text)  # noqa: S506  a SafeLoader


def test_every_field_is_described(crd: Schema) -> None:
    # The API server allows no description of metadata.
    bare = [p for p, s in walk(schema_of(crd)) if not s.get("description") and p != ".metadata"]
    assert bare == []


def test_every_description_is_a_sentence(crd: Schema) -> None:
    loose = [p for p, s in walk(schema_of(crd)) if not s.get("description", ".").endswith(".")]
    assert loose == []


def test_every_list_and_text_of_the_spec_is_bounded(crd: Schema) -> None:
    spec = schema_of(crd)["properties"]["spec"]
    unbounded = [
        path
        for path, s in walk(spec)
        if (s.get("type") == "array" and "maxItems" not in s)
        or (s.get("type") == "string" and "maxLength" not in s and "enum" not in s)
    ]
    assert unbounded == []


def test_every_rule_says_what_to_write(crd: Schema) -> None:
    rules = [r for _, s in walk(schema_of(crd)) for r in s.get("x-kubernetes-validations", [])]
    assert len(rules) == 236
    hints = ("write ", "delete the job", "such as")
    assert [r["message"] for r in rules if not any(h in r["message"] for h in hints)] == []


MUTABLE = {"suspend", "activeDeadline", "startDeadline", "ttlAfterFinished", "notify"}


def test_every_field_but_those_that_can_be_honoured_is_immutable(crd: Schema) -> None:
    spec = schema_of(crd)["properties"]["spec"]
    rule = next(r for r in spec["x-kubernetes-validations"] if "oldSelf" in r["rule"])
    words = " ".join(rule["rule"].split())
    required = set(spec["required"])
    expected = [
        f"self.{field} == oldSelf.{field}"
        if field in required
        else f"(has(self.{field}) ? has(oldSelf.{field}) && self.{field} == oldSelf.{field}"
        f" : !has(oldSelf.{field}))"
        for field in set(spec["properties"]) - MUTABLE
    ]
    # What Kueue and people settle before a job goes on: how wide it runs, and on which nodes.
    spark = next(term for term in expected if term.startswith("(has(self.spark)"))
    expected[expected.index(spark)] = f"((has(oldSelf.suspend) && oldSelf.suspend) || {spark})"
    assert [term for term in expected if term not in words] == []
    assert len(words) == len(" && ".join(expected))
    assert all(field in rule["message"] for field in MUTABLE)
    assert job_config.MUTABLE == MUTABLE


def test_the_columns(crd: Schema) -> None:
    columns = crd["spec"]["versions"][0]["additionalPrinterColumns"]
    assert [c["name"] for c in columns if not c.get("priority")] == [
        "Verdict", "Phase", "Cases", "Passed", "Failed", "Regressed", "Errored", "Age",
    ]  # fmt: skip


def test_names_and_status(crd: Schema) -> None:
    names, version = crd["spec"]["names"], crd["spec"]["versions"][0]
    assert (names["kind"], names["plural"], names["shortNames"], names["categories"]) == (
        "SimulationJob",
        "simulationjobs",
        ["simjob"],
        ["bagpipe"],
    )
    assert (version["name"], version["subresources"]) == ("v1alpha1", {"status": {}})
    conditions = schema_of(crd)["properties"]["status"]["properties"]["conditions"]
    assert conditions["x-kubernetes-list-type"] == "map"
    assert conditions["x-kubernetes-list-map-keys"] == ["type"]


def defaults(schema: Schema) -> Any:
    """What the API server fills into an empty object."""
    filled = {}
    for name, field in (schema.get("properties") or {}).items():
        if "default" in field:
            filled[name] = defaults(field) or field["default"]
    return filled


def cut_to(model: Any, filled: Any) -> Any:
    """What the schema fills in, of a model that has more to say."""
    if not isinstance(filled, dict):
        return model
    return {name: cut_to(model[name], filled[name]) for name in filled}


def test_the_models_have_the_schema_s_defaults(crd: Schema) -> None:
    required = {
        "source": {"bags": ["file:///x.bag"]},
        "stack": {"image": "i", "command": ["c"]},
        "record": {"topics": ["/t"]},
        "output": {"uri": "file:///out"},
    }
    model = SimulationJobSpec.model_validate(required).model_dump(by_alias=True)
    spec = schema_of(crd)["properties"]["spec"]
    filled = defaults(spec)
    assert {name: cut_to(model[name], filled[name]) for name in filled} == filled
    fragment = defaults(spec["properties"]["source"])["fragment"]
    assert model["source"]["fragment"] == fragment


def test_the_models_have_the_schema_s_fields(crd: Schema) -> None:
    def fields(schema: Schema, path: str) -> Iterator[str]:
        for name, field in (schema.get("properties") or {}).items():
            if field["description"].startswith("Refused"):
                continue  # there to say what to write instead; no model takes it over
            yield f"{path}{name}"
            yield from fields(field, f"{path}{name}.")
            yield from fields(field.get("items") or {}, f"{path}{name}.")
            values = field.get("additionalProperties")
            yield from fields(values if isinstance(values, dict) else {}, f"{path}{name}.")

    def models_in(annotation: Any) -> Iterator[Any]:
        if hasattr(annotation, "model_fields"):
            yield source_model() if annotation is Source else annotation
        for part in getattr(annotation, "__args__", ()):
            yield from models_in(part)

    def of_model(model: Any, path: str) -> Iterator[str]:
        for field in model.model_fields.values():
            name = f"{path}{field.alias}"
            yield name
            for kind in models_in(field.annotation):
                yield from of_model(kind, f"{name}.")

    spec = schema_of(crd)["properties"]["spec"]
    # Rules and values are texts, lists or maps, and executors a number or a map, which no
    # structural schema can say.
    either = ("matrix.exclude.", "matrix.variables.", "spark.executors.")
    of_models = {f for f in of_model(SimulationJobSpec, "") if not f.startswith(either)}
    assert of_models == set(fields(spec, ""))


def generator() -> Any:
    """crds/generate.py as a module."""
    location = importlib.util.spec_from_file_location("generate", ROOT / "crds" / "generate.py")
    assert location is not None
    assert location.loader is not None
    generate = importlib.util.module_from_spec(location)
    location.loader.exec_module(generate)
    return generate


def test_what_is_derived_is_up_to_date() -> None:
    generate = generator()
    stale = [path.name for path, text in generate.derived().items() if path.read_text() != text]
    assert stale == [], "run python3 crds/generate.py"
