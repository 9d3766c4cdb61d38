"""The agent's crates have no circles of modules, and folders that depend in one direction."""

import re
from collections.abc import Iterator
from graphlib import CycleError, TopologicalSorter
from pathlib import Path

import pytest

CRATES = Path(__file__).parents[3] / "images/ros/crates"
# Each knows those after it.
AGENT = ("cli", "verbs", "serve", "metrics", "engine", "stack", "case", "size")
# A type with its methods in several files.
TOGETHER = {
    "bag": [{"bag", "compressor", "copy", "messages", "scan", "slice", "timeline", "unpack",
             "upgrade", "writer"}, {"compression", "lz4", "model", "record"}],
    "pipe": [{"duplex", "leftovers"}],
    "python": [{"bag", "writer"}],
    "ros": [{"node", "slave"}],
}  # fmt: skip

Graph = dict[str, set[str]]


def modules(crate: str) -> dict[str, str]:
    """Each module's text by its path below `crate::`, without comments and tests."""
    found = {}
    for path in sorted((CRATES / crate / "src").rglob("*.rs")):
        name = "::".join(path.relative_to(CRATES / crate / "src").with_suffix("").parts)
        text = re.split(r"#\[cfg\(test\)\]\s*mod \w+ \{", path.read_text())[0]
        found[name.removesuffix("::mod")] = re.sub(r"//.*", "", text)
    return {name: text for name, text in found.items() if not name.startswith("rehearsal")}


def exported(root: str) -> dict[str, str]:
    """What the crate's root re-exports, with its module."""
    names: dict[str, str] = {}
    for module, group in re.findall(r"pub use (\w+)::\{?([^;]*?)\}?;", root):
        names |= dict.fromkeys(re.findall(r"\w+", group), module)
    return names


def paths(text: str) -> Iterator[str]:
    """What stands after `crate::`, groups taken apart."""
    for group in re.findall(r"crate::\{(.*?)\};", text, re.DOTALL):
        yield from (part.strip() for part in re.sub(r"::\{[^}]*\}", "", group).split(","))
    yield from re.findall(r"crate::(\w[\w:]*)", text)


def graph(crate: str) -> Graph:
    """Which module names which, by the longest path that is one."""
    known = modules(crate)
    roots = [known.pop(name) for name in ("lib", "main") if name in known]
    names = exported("".join(roots))
    edges: Graph = {name: set() for name in known}
    for name, text in known.items():
        for path in paths(text):
            words = path.split("::")
            prefixes = ["::".join(words[:end]) for end in range(len(words), 0, -1)]
            target = next((p for p in prefixes if p in known), names.get(words[0], ""))
            edges[name] |= {target} - {name, ""}
        # A module and its own file are one where the parent declares it.
        edges[name] -= {other for other in edges[name] if other.startswith(f"{name}::")}
    return edges


def joined(edges: Graph, groups: list[set[str]]) -> Graph:
    """The graph with each group as one node."""
    of = {name: "+".join(sorted(group)) for group in groups for name in group}
    merged: Graph = {}
    for name, others in edges.items():
        mine = of.get(name, name)
        merged.setdefault(mine, set()).update({of.get(o, o) for o in others} - {mine})
    return merged


def circle(edges: Graph) -> list[str]:
    try:
        TopologicalSorter(edges).prepare()
    except CycleError as error:
        return [str(name) for name in error.args[1]]
    return []


@pytest.mark.parametrize("crate", ["agent", "bag", "binpipe", "pipe", "python", "replay", "ros"])
def test_no_modules_of_a_crate_are_a_circle(crate: str) -> None:
    edges = graph(crate)
    assert sum(map(len, edges.values())) >= len(edges) // 3, "the imports were not found"
    assert circle(joined(edges, TOGETHER.get(crate, []))) == []


def test_the_agent_s_folders_depend_in_one_direction() -> None:
    order = {name: place for place, name in enumerate(AGENT)}
    edges = graph("agent")
    assert {name.split("::")[0] for name in edges} == set(AGENT)
    upward = [
        f"{name} -> {other}"
        for name, others in edges.items()
        for other in others
        if order[name.split("::")[0]] > order[other.split("::")[0]]
    ]
    assert upward == []


def test_a_circle_is_found() -> None:
    assert circle({"a": {"b"}, "b": {"c"}, "c": {"a"}}) != []
    assert circle(joined({"a": {"b"}, "b": {"c"}, "c": {"a"}}, [{"a", "b", "c"}])) == []
    assert sorted(paths("use crate::{Bag, lz4, x::{y, z}};\ncrate::a::b::C")) == [
        "Bag", "a::b::C", "lz4", "x",
    ]  # fmt: skip
