"""The agent's crates have no circles of modules, and folders that depend in one direction."""

from graphlib import CycleError, TopologicalSorter
from pathlib import Path

import pytest

from docs.site.rust_modules import (
    CRATES,
    ROOT,
    Graph,
    absolute,
    crates,
    graph,
    trees,
    undeclared_of_tests,
    unreachable,
    without_tests,
)

# Each knows those after it.
AGENT = ("cli", "verbs", "serve", "metrics", "engine", "stack", "case", "formats", "size", ROOT)
# A type with its methods in several files, and modules with children that know them.
TOGETHER = {
    "agent": [{"engine::exec", "engine::exec::pump"}, {"engine::ros1", "engine::ros1::simulator"}],
    "rosbag": [{"bag", "copy", "messages", "scan", "slice", "timeline", "unpack", "upgrade",
             "writer"}, {"model", "record"}],
    "mcap": [{"writer", "writer::chunk"}],
    "wire": [{"duplex", "leftovers"}],
    "python": [{"bag", "writer"}],
    "replay": [{"machine", "machine::gauge"}, {"time", "time::by_hand"},
               {"processes", "processes::sockets", "processes::starting", "processes::waiting"}],
    "ros1": [{"node", "slave"}],
    "ros2": [{"node", "node::others", "node::recorded"},
             {"topic", "topic::matching", "topic::sending", "topic::subscribers"}],
}  # fmt: skip
# At the least so many edges were found, so that a source that is read wrongly is noticed.
LEAST_EDGES = {
    "agent": 80, "cyclonedds": 0, "flow_control": 0, "graph": 5, "log": 5, "mcap": 40,
    "replay": 140, "ros1": 25,
    "ros2ledger": 12,
    "ros2player": 25,
    "rosbag": 60,
    "wire": 10,
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


@pytest.mark.parametrize("crate", crates())
def test_no_modules_of_a_crate_are_a_circle(crate: str) -> None:
    edges = graph(crate)
    assert sum(map(len, edges.values())) >= LEAST_EDGES.get(crate, 1)
    assert circle(joined(edges, TOGETHER.get(crate, []))) == []


@pytest.mark.parametrize("crate", crates())
def test_each_file_of_a_crate_is_compiled(crate: str) -> None:
    assert unreachable(CRATES / crate / "src") == []
    assert undeclared_of_tests(crate) == []


def test_a_file_that_no_module_declares_is_found(tmp_path: Path) -> None:
    for name, text in {
        "lib.rs": "mod a;\nmod b;\n// mod lost;\n", "a.rs": "mod inner;", "a/inner.rs": "",
        "a/tests.rs": "", "b/mod.rs": "#[cfg(test)]\nmod tests;", "b/tests.rs": "", "lost.rs": "",
    }.items():  # fmt: skip
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_text(text)
    assert unreachable(tmp_path) == ["a/tests.rs", "lost.rs"]


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


def test_paths_are_those_of_rust() -> None:
    assert list(trees("crate::{Bag, lz4 as x, a::{b::{C, D}, self}}")) == [
        ["crate", "Bag"], ["crate", "lz4"], ["crate", "a", "b", "C"], ["crate", "a", "b", "D"],
        ["crate", "a", "self"],
    ]  # fmt: skip
    known = dict.fromkeys(("crate", "a", "a::b", "a::c"), "")
    assert absolute(["super", "c", "X"], "a::b", known) == ["a", "c", "X"]
    assert absolute(["super", "super", "Y"], "a::b", known) == ["Y"]
    assert absolute(["self", "b"], "a", known) == ["a", "b"]
    assert absolute(["c", "X"], "a", known) == ["a", "c", "X"]
    assert absolute(["std", "fs"], "a", known) is None


def test_only_tests_are_left_out() -> None:
    text = "a; #[cfg(test)] mod tests { fn x() { y } } b; #[cfg(test)]\nmod rehearsal;\nc;"
    assert without_tests(text) == ("a;  b; \nc;", {"tests", "rehearsal"})
