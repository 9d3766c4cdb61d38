"""HELLO's case has one shape: what its schema allows, the real agent reads as the worker wrote it,
and what the worker's model forbids, the agent refuses.
"""

import copy
import functools
import json
import operator
import subprocess
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from bagpipe.wire.frames import Encoder
from bagpipe.wire.hello_case import hello_case_schema, valid_case
from bagpipe.wire.session import _hello
from tests.shapes import Shapes

pytestmark = pytest.mark.integration

Json = Any
SCHEMA = hello_case_schema()
SHAPES = Shapes(SCHEMA)
# Of each type some, at and behind the schema's bounds.
VALUES: list[Json] = [
    None, True, False, 0, 7, -1, 2**64 - 1, 0.0, 1.5, -0.5, 2678400, 2678400.5, "", "x", "exec",
    "count", "max", "lockstep", [], [""], ["x"], [7], [None], [{}], [[]], {}, {"x": "y"}, {"x": 7},
    {"x": None},
]  # fmt: skip
# Every field is there.
FULL: Json = {
    "id": "a", "job": "n/j", "engine": "ros1", "source": "pvc://r/a.bag",
    "window": {"lead_in_start": 1, "start": 2, "end": 3},
    "topics": ["/a"],
    "stack": {
        "command": ["x", ""], "environment": {"A": "b"}, "parameters": {"/a": [None, {"b": 1}]},
        "remap": {"/a": "/b"},
        "master": "image",
        "qos": {"/a": {"reliability": "bestEffort", "durability": "volatile", "depth": 1}},
        "player": "dds",
        "active": ["/n"],
        "flow_control": False,
    },
    "playback": {
        "mode": "lockstep", "rate": 2, "wait_for": ["/n"],
        "steps": [
            {"trigger": "/a", "answer": "/b", "deadline": 1, "by": "stamp", "optional": True},
        ],
    },
    "faults": {"allow": ["StackExited"]},
    "record": {"topics": ["/.*"], "byte_budget": 9},
    "deadlines": {"start": 1, "subscribe": 2.5, "drain": 3, "stop": 4, "case": 5},
    "simulator": {"publications": [{
        "topic": "/a", "type": "t/T", "md5sum": "0", "definition": "d", "latching": True,
        "recorded": False,
    }]},
}  # fmt: skip


def read_by_agent(agent: Path, cases: Iterable[Json]) -> list[Json]:
    """What the agent prints of each case, as the worker encodes it."""
    frames = b"".join(_hello(Encoder(), "0" * 32, case) for case in cases)
    done = subprocess.run(
        [agent, "hello"], input=frames, capture_output=True, check=True, timeout=60
    )
    return [json.loads(line) for line in done.stdout.splitlines()]


def cases() -> "st.SearchStrategy[Json]":
    """With a simulator in lock-step alone, which is the schema's if and then."""
    then = SCHEMA["then"]["properties"]["playback"]["properties"]["mode"]["const"]

    def in_lockstep(case: Json) -> Json:
        if "simulator" not in case:
            return case
        return case | {"playback": case.get("playback", {}) | {"mode": then}}

    return SHAPES.allowed(SCHEMA).map(in_lockstep)


@settings(
    max_examples=150, deadline=None,
    suppress_health_check=[HealthCheck.function_scoped_fixture, HealthCheck.too_slow],
)  # fmt: skip
@given(drawn=st.lists(cases(), min_size=1, max_size=4))
def test_what_the_schema_allows_the_agent_reads_field_by_field(
    agent_binary: Path, drawn: list[Json]
) -> None:
    for case, read in zip(drawn, read_by_agent(agent_binary, drawn), strict=True):
        valid_case(case)
        assert read == {"case": SHAPES.filled(SCHEMA, case)}


def places(
    value: Json, schema: Json, path: tuple[str | int, ...] = ()
) -> Iterator[tuple[Any, ...]]:
    """The path of each value that a schema describes."""
    schema = SHAPES.resolved(schema)
    if path:
        yield path
    if isinstance(value, dict) and "properties" in schema:
        for name, of in schema["properties"].items():
            yield from places(value[name], of, (*path, name))
    elif isinstance(value, dict) and isinstance(schema.get("additionalProperties"), dict):
        for name in value:
            yield from places(value[name], schema["additionalProperties"], (*path, name))
    elif isinstance(value, list) and "items" in schema:
        for at, each in enumerate(value):
            yield from places(each, schema["items"], (*path, at))


def changed(path: tuple[Any, ...], *value: Json) -> Json:
    """The full case with a value in place of another, or without it."""
    case = copy.deepcopy(FULL)
    *parents, last = path
    inner = case
    for part in parents:
        inner = inner[part]
    if value:
        inner[last] = value[0]
    else:
        del inner[last]
    return case


def replacements(path: tuple[Any, ...]) -> list[Json]:
    """Other values; for a map also the list of its values, which serde takes for a struct."""
    value = functools.reduce(operator.getitem, path, FULL)
    return [*VALUES, list(value.values())] if isinstance(value, dict) else VALUES


def is_valid(case: Json) -> bool:
    try:
        valid_case(case)
    except ValueError:
        return False
    return True


def test_what_one_end_refuses_the_other_refuses(agent_binary: Path) -> None:
    assert is_valid(FULL)
    paths = list(places(FULL, SCHEMA))
    assert len(paths) > 50
    replaced = [(path, value) for path in paths for value in replacements(path)]
    mutations: list[tuple[Any, ...]] = [*replaced, *((path,) for path in paths)]
    mutated = [changed(path, *value) for path, *value in mutations]
    verdicts = [is_valid(case) for case in mutated]
    assert verdicts.count(False) > 500
    assert verdicts.count(True) > 100
    read = ["case" in line for line in read_by_agent(agent_binary, mutated)]
    wrong = [
        each for each, ours, theirs in zip(mutations, verdicts, read, strict=True) if ours != theirs
    ]
    assert wrong == []
