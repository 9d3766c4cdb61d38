"""Sources declare themselves: their order, what a spec has of them, and who asks for them."""

import ast
import json
import pickle
import tomllib
from pathlib import Path
from typing import Any

import pytest
import yaml

from bagpipe.source_fields import source_fields, source_names
from bagpipe.source_spec import Source, source_model
from bagpipe.spec import SimulationJobSpec
from tests.unit.bagpipe.jobs import make_spec

ROOT = Path(__file__).parents[3]
FOLDER = ROOT / "images/spark/src/bagpipe/source"
OURS = ("bags", "sequence", "files", "simulator", "catalogue")
PIECE = {"bag": "pvc://r/a.bag", "to": "3s"}
SIMULATED = {
    "source": {
        "simulator": {"duration": "9s", "recorded": [{"bag": "s3://b/c", "topics": ["/c"]}]}
    },
    "playback": {"mode": "lockstep", "steps": [{"trigger": "/ego/odom", "answer": "/cmd"}]},
}
EXEC = {"stack": {"image": "i", "command": ["c"], "engine": "exec"}, "record": None}
# A spec of each kind, and the URIs that its cases are read from.
KINDS: dict[str, tuple[dict[str, Any], list[str]]] = {
    "bags": ({"source": {"bags": ["s3://b/*.bag", "s3://b/*.bag"]}}, ["s3://b/*.bag"] * 2),
    "sequence": ({"source": {"sequence": [PIECE, PIECE]}}, ["pvc://r/a.bag"]),
    "files": (EXEC | {"source": {"files": ["pvc://a/b"]}}, ["pvc://a/b"]),
    "simulator": (SIMULATED, ["s3://b/c"]),
    "catalogue": (
        {"source": {"catalogue": {"uri": "s3://b/c.csv", "where": "x", "within": ["pvc://r/"]}}},
        ["s3://b/c.csv", "pvc://r/"],
    ),
}


def test_the_folders_are_the_sources_and_in_the_contract() -> None:
    assert source_names() == OURS
    assert sorted(OURS) == sorted(path.parent.name for path in FOLDER.glob("*/fields.py"))
    assert sorted(OURS) == sorted(path.parent.name for path in FOLDER.glob("*/source.py"))
    contracts = tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]["importlinter"]
    (modules,) = (
        each["modules"]
        for each in contracts["contracts"]
        if each["name"].startswith("A source knows no other source")
    )
    assert sorted(modules) == sorted(f"bagpipe.source.{name}" for name in OURS)


def test_a_spec_s_source_has_their_keys_in_their_order() -> None:
    fields = source_model().model_fields
    assert list(fields) == [*OURS, "topics", "fragment"]
    written = json.loads(make_spec().model_dump_json(by_alias=True))["source"]
    assert list(written) == list(fields)
    crd = yaml.safe_load((ROOT / "crds/simulationjobs.yaml").read_text())
    schema = crd["spec"]["versions"][0]["schema"]["openAPIV3Schema"]["properties"]["spec"]
    assert list(schema["properties"]["source"]["properties"]) == list(fields)


@pytest.mark.parametrize("name", OURS)
def test_what_is_written_is_its_own_and_comes_back_from_another_process(name: str) -> None:
    changed, uris = KINDS[name]
    spec = make_spec(**changed)
    assert (spec.source.kind, spec.source.uris) == (name, uris)
    assert spec.source.own == getattr(spec.source, name)
    back: SimulationJobSpec = pickle.loads(pickle.dumps(spec))  # noqa: S301
    assert (back, type(back.source)) == (spec, source_model())
    assert back.source.model_fields_set == spec.source.model_fields_set == {name}
    assert back.model_dump_json() == spec.model_dump_json()


@pytest.mark.parametrize("name", OURS)
def test_what_is_declared_meaningless_is_beside_the_key(name: str) -> None:
    declared = {path for paths in source_fields(name).meaningless for path in paths}
    assert declared <= set(Source.model_fields)
    assert declared == ({"topics"} if name in {"files", "simulator"} else set())


def test_nobody_else_asks_for_a_source_by_its_name() -> None:
    """`spec.source.simulator` outside of its folder would be a line that each new one needs."""
    found = {
        f"{path.relative_to(ROOT)}:{node.lineno}"
        for folder in ("images/spark/src", "operator/src")
        for path in (ROOT / folder).rglob("*.py")
        for node in ast.walk(ast.parse(path.read_text()))
        if isinstance(node, ast.Attribute)
        and node.attr in OURS
        and isinstance(node.value, ast.Attribute)
        and node.value.attr == "source"
    }
    assert found == set()
