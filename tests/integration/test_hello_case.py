"""HELLO's case has one shape: what its schema allows, the real agent reads as the worker wrote it,
and what the worker's model forbids, the agent refuses.
"""

import copy
import functools
import json
import operator
import subprocess
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from typing import Any

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from bagpipe.wire.frames import Encoder
from bagpipe.wire.hello_case import hello_case_schema, valid_case
from bagpipe.wire.session import _hello

pytestmark = pytest.mark.integration

Json = Any
SCHEMA = hello_case_schema()
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


def resolved(schema: Json) -> Json:
    """A schema without a reference."""
    if "$ref" not in schema:
        return schema
    return SCHEMA["$defs"][schema["$ref"].rpartition("/")[2]] | {
        key: value for key, value in schema.items() if key != "$ref"
    }


def read_by_agent(agent: Path, cases: Iterable[Json]) -> list[Json]:
    """What the agent prints of each case, as the worker encodes it."""
    frames = b"".join(_hello(Encoder(), "0" * 32, case) for case in cases)
    done = subprocess.run(
        [agent, "hello"], input=frames, capture_output=True, check=True, timeout=60
    )
    return [json.loads(line) for line in done.stdout.splitlines()]


def allowed(schema: Json) -> "st.SearchStrategy[Json]":
    """Values that a schema allows, as far as MessagePack can say them."""
    schema = resolved(schema)
    if "enum" in schema:
        return st.sampled_from(schema["enum"])
    return OF_TYPE[schema.get("type")](schema)


def maps(schema: Json) -> "st.SearchStrategy[Json]":
    if "properties" in schema:
        return st.builds(dict.__or__, unknown(schema), known(schema))
    return st.dictionaries(st.text(max_size=5), allowed(schema["additionalProperties"]))


def numbers(schema: Json) -> "st.SearchStrategy[Json]":
    bounds = {"min_value": schema.get("minimum"), "max_value": schema.get("maximum")}
    return st.integers(0, 1000) | st.floats(**bounds, allow_nan=False, allow_infinity=False)


def items(schema: Json) -> "st.SearchStrategy[Json]":
    each, first = allowed(schema["items"]), schema.get("prefixItems")
    least = schema.get("minItems", 0)
    if not first:
        return st.lists(each, min_size=least, max_size=3)
    return st.builds(lambda one, more: [one, *more], allowed(first[0]), st.lists(each, max_size=3))


def known(schema: Json) -> "st.SearchStrategy[Json]":
    required = set(schema.get("required", []))
    fields = {name: allowed(of) for name, of in schema["properties"].items()}
    return st.fixed_dictionaries(
        {name: of for name, of in fields.items() if name in required},
        optional={name: of for name, of in fields.items() if name not in required},
    )


def unknown(schema: Json) -> "st.SearchStrategy[Json]":
    """Fields of a later version, which the schema allows everywhere."""
    assert schema["additionalProperties"] is True
    return st.dictionaries(st.text(max_size=5).map("later_{}".format), ANYTHING, max_size=1)


ANYTHING: "st.SearchStrategy[Json]" = st.recursive(
    st.none() | st.booleans() | st.integers(-(2**63), 2**64 - 1) | st.text(max_size=5)
    | st.floats(allow_nan=False, allow_infinity=False),
    lambda inner: st.lists(inner, max_size=2)
    | st.dictionaries(st.text(max_size=3), inner, max_size=2),
    max_leaves=4,
)  # fmt: skip


OF_TYPE: dict[str | None, Callable[[Json], "st.SearchStrategy[Json]"]] = {
    "object": maps,
    "array": items,
    "number": numbers,
    "string": lambda schema: st.text(min_size=schema.get("minLength", 0), max_size=20),
    "integer": lambda schema: st.integers(schema["minimum"], schema["exclusiveMaximum"] - 1),
    "boolean": lambda _: st.booleans(),
    None: lambda _: ANYTHING,
}


def cases() -> "st.SearchStrategy[Json]":
    """With a simulator in lock-step alone, which is the schema's if and then."""
    then = SCHEMA["then"]["properties"]["playback"]["properties"]["mode"]["const"]

    def in_lockstep(case: Json) -> Json:
        if "simulator" not in case:
            return case
        return case | {"playback": case.get("playback", {}) | {"mode": then}}

    return allowed(SCHEMA).map(in_lockstep)


def filled(schema: Json, value: Json) -> Json:
    """A case with the schema's defaults, and without what the schema does not know."""
    schema = resolved(schema)
    if schema.get("type") == "array":
        return [filled(schema["items"], each) for each in value]
    if schema.get("type") == "number":
        return float(value)
    if "properties" not in schema:
        return value
    return {
        name: filled(of, value.get(name, copy.deepcopy(of.get("default"))))
        for name, of in schema["properties"].items()
        if name in value or "default" in resolved(of)
    }


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
        assert read == {"case": filled(SCHEMA, case)}


def places(
    value: Json, schema: Json, path: tuple[str | int, ...] = ()
) -> Iterator[tuple[Any, ...]]:
    """The path of each value that a schema describes."""
    schema = resolved(schema)
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
