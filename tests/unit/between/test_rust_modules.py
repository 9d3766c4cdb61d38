"""The agent's crates have no circles of modules, and folders that depend in one direction."""

from graphlib import CycleError, TopologicalSorter

import pytest

from docs.site.rust_modules import Graph, graph, paths

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
