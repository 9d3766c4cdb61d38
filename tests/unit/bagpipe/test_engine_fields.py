"""Engines declare themselves: who asks for one by its name, and what a spec loads to know them."""

import ast
import re
import subprocess
import sys
import tomllib
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import pytest

from bagpipe import engine_fields
from bagpipe.engine_fields import EngineFields, engine_names, fields_of, refusal
from bagpipe.source_fields import source_names
from tests.unit.bagpipe.jobs import make_spec
from tests.unit.crds.test_crd import generator

ROOT = Path(__file__).parents[3]
SOURCES = ("images/spark/src", "operator/src", "crds", "charts")
# Where a name of an engine may stand outside of the engines' folders, and why.
NAMED = {
    # Whose messages a recording is to have, and the profile that MCAP has for them: no engine's.
    ("images/spark/src/bagpipe/cli/bag.py", "ros1"),
    ("images/spark/src/bagpipe/cli/bag.py", "ros2"),
    ("images/spark/src/bagpipe/cli/bag_for_ros2.py", "ros2"),
    # The API's default for a job that names none.
    ("images/spark/src/bagpipe/engine_fields.py", "ros1"),
    # What the messages of a bag are, as recordings call it.
    ("images/spark/src/bagpipe/encodings.py", "ros1"),
    # The kind of a probe, as Kubernetes calls it.
    ("operator/src/bagpipe_operator/jobs/pods/executor_template.py", "exec"),
}
AGENT = ROOT / "images/agent/crates/agent/src"


def literals(path: Path) -> Iterator[str]:
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Constant) and node.value in engine_names():
            yield str(node.value)


def test_nobody_else_asks_for_an_engine_by_its_name() -> None:
    found = {
        (str(path.relative_to(ROOT)), name)
        for folder in SOURCES
        for path in (ROOT / folder).rglob("*.py")
        if "bagpipe/engine/" not in str(path)
        for name in literals(path)
    }
    assert found == NAMED


def test_nobody_else_in_the_agent_asks_for_an_engine_by_its_name() -> None:
    folders = {path.parent.name for path in AGENT.glob("engine/*/entry.rs")}
    assert {fields_of(name).agent for name in engine_names()} == folders
    named = re.compile(rf'"(?:{"|".join(folders)})"|engine::(?:{"|".join(folders)})\b')
    found = {
        (str(path.relative_to(AGENT)), word)
        for path in AGENT.rglob("*.rs")
        if path.relative_to(AGENT).parts[0] != "engine"
        for word in named.findall(path.read_text().partition("#[cfg(test)]")[0])
    }
    assert found == set()


def test_the_folders_are_the_engines_and_in_the_contract() -> None:
    folder = ROOT / "images/spark/src/bagpipe/engine"
    assert sorted(engine_names()) == sorted(p.parent.name for p in folder.glob("*/fields.py"))
    contracts = tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]["importlinter"]
    (modules,) = (
        each["modules"]
        for each in contracts["contracts"]
        if each["name"] == "An engine knows no other engine"
    )
    assert sorted(modules) == sorted(f"bagpipe.engine.{name}" for name in engine_names())


@pytest.mark.parametrize("name", engine_names())
def test_what_is_declared_is_in_the_spec(name: str) -> None:
    fields = fields_of(name)
    assert set(fields.sources) <= set(source_names())
    paths = [*fields.needed, *(path for paths in fields.meaningless for path in paths)]
    for path in paths:
        model: object = make_spec()
        for part in path.split("."):
            assert part in type(model).model_fields, path  # type: ignore[attr-defined]
            model = getattr(model, part)


def test_a_field_below_what_is_left_out_is_not_written(monkeypatch: pytest.MonkeyPatch) -> None:
    usual = EngineFields(agent="exec", unmarked_lines="stack", sources=("bags",))
    needs = replace(usual, needed={"record.topics": "topics are missing"})
    refuses = replace(usual, meaningless={("record.topics",): "topics have no meaning"})
    recording = make_spec()
    without = recording.model_copy(update={"record": None})
    monkeypatch.setattr(engine_fields, "fields_of", {"a": needs, "b": refuses}.__getitem__)
    assert refusal(without, "a", "bags", "bags") == "topics are missing"
    assert refusal(without, "b", "bags", "bags") is None
    assert refusal(recording, "a", "bags", "bags") is None
    assert refusal(recording, "b", "bags", "bags") == "topics have no meaning"


def test_a_spec_loads_nothing_that_runs_a_case() -> None:
    code = (
        "import sys; from bagpipe.spec import SimulationJobSpec as S; S.model_validate({'source':"
        "{'files': ['pvc://a/b']}, 'stack': {'image': 'i', 'command': ['c'], 'engine': 'exec'},"
        "'output': {'uri': 'pvc://a/o'}}); print(*sorted(m for m in sys.modules if"
        " m.startswith(('bagpipe.engine.', 'bagpipe.source.', 'bagpipe.wire', 'bagpipe.storage',"
        " 'bagpipe.run'))))"
    )
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, timeout=60, check=True
    )
    folders = [f"bagpipe.engine.{name}" for name in engine_names()]
    folders += [f"bagpipe.source.{name}" for name in source_names()]
    fields = [folder + of for folder in folders for of in ("", ".fields")]
    assert set(done.stdout.split()) <= set(fields)
    assert "bagpipe.engine.exec.fields" in done.stdout


def test_the_crd_s_rules_let_an_engine_take_what_it_declares() -> None:
    generate = generator()
    committed = generate.JOBS.read_text()
    engines = {name: fields_of(name) for name in engine_names()}
    assert generate.with_engines(committed, engines) == committed
    other = EngineFields(agent="exec", unmarked_lines="stack", sources=("files", "simulator"))
    text = generate.with_engines(committed, engines | {"other": other})
    for words in (
        "!has(self.source.files) || (has(self.stack.engine) && self.stack.engine in ['exec', ",
        "source.files are for stack.engine: exec or other, which reads",
        "!has(self.stack.engine) || self.stack.engine in ['ros1', 'ros2', 'other']",
        "has(self.record) || (has(self.stack.engine) && self.stack.engine in ['exec', 'other'])",
        "only stack.engine: exec or other goes without it",
        "enum: [ros1, exec, ros2, other]",
        "source.simulator is for stack.engine: ros1 or ros2 or other: write that",
    ):
        assert words in text
    with pytest.raises(SystemExit, match=r"generate\.py looks for one line with"):
        generate.with_engines(committed.replace("enum: [ros1", "enums: [ros1"), engines)
