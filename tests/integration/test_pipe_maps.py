"""The maps of the pipe have one shape: what a schema allows, the agent's structs hold and write
field by field, the worker's model takes, and what a required field is missing from both refuse.
"""

import re
import subprocess
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any

import pytest
from hypothesis import HealthCheck, Phase, given, settings
from hypothesis import strategies as st
from pydantic import TypeAdapter, ValidationError

from bagpipe.engine.exec.result import ProgramResult
from bagpipe.engine.replay_result import ReplayResult
from bagpipe.wire.frames import Decoder, Encoder, FrameType
from bagpipe.wire.maps.session import (
    Abort,
    AgentHello,
    End,
    FileFromAgent,
    FileToAgent,
    Metric,
    WorkerHello,
)
from bagpipe.wire.maps.turns import Answer, Step
from docs.site.pipe_maps import schemas
from tests.shapes import Shapes

pytestmark = pytest.mark.integration

Json = Any
WHOLE = schemas()
SHAPES = Shapes(WHOLE)
# As the agent's verb `maps` names them.
MODELS: dict[str, tuple[FrameType, Any]] = {
    "worker-hello": (FrameType.HELLO, WorkerHello),
    "agent-hello": (FrameType.HELLO, AgentHello),
    "file": (FrameType.FILE, FileToAgent),
    "metric": (FrameType.METRIC, Metric),
    "end": (FrameType.END, End),
    "abort": (FrameType.ABORT, Abort),
    "step": (FrameType.STEP, Step),
    "answer": (FrameType.ANSWER, Answer),
    "replay-result": (FrameType.RESULT, ReplayResult),
    "program-result": (FrameType.RESULT, ProgramResult),
}
REPLAY, PROGRAM = "replay-result", "program-result"


def written_by_agent(agent: Path, name: str, maps: Iterable[Json]) -> list[Json]:
    """What the agent's struct writes of each map; the sentence where it refuses one."""
    encoder, (kind, _) = Encoder(), MODELS[name]
    frames = b"".join(encoder.encode_fields(kind, each) for each in maps)
    done = subprocess.run(
        [agent, "maps", name], input=frames, capture_output=True, check=True, timeout=60
    )
    read = [frame.fields() for frame in Decoder().feed(done.stdout)]
    return [each["message"] if each.get("reason") == "Refused" else each for each in read]


def schema_of(name: str) -> Json:
    return SHAPES.resolved({"$ref": MODELS[name][1].__name__})


def is_refused(name: str, value: Json) -> bool:
    try:
        TypeAdapter(MODELS[name][1]).validate_python(value)
    except ValidationError:
        return True
    return False


def drawn(name: str) -> "st.SearchStrategy[Json]":
    """A map of a schema; of STEP one whose messages all lie in it."""
    maps = SHAPES.allowed(schema_of(name))
    if name == "step":
        inside = st.tuples(st.integers(0, 9), st.binary(max_size=9)).map(list)
        return st.builds(lambda step, sent: step | {"messages": sent}, maps, st.lists(inside))
    return maps


@pytest.mark.parametrize("name", MODELS)
def test_what_the_schema_allows_the_agent_writes_field_by_field(
    agent_binary: Path, name: str
) -> None:
    schema = schema_of(name)

    @settings(
        max_examples=60, deadline=None, suppress_health_check=[HealthCheck.too_slow],
        phases=(Phase.generate,),  # each example is a process: looking for a smaller one is slow
    )  # fmt: skip
    @given(maps=st.lists(drawn(name), min_size=1, max_size=4))
    def compared(maps: list[Json]) -> None:
        for each, written in zip(maps, written_by_agent(agent_binary, name, maps), strict=True):
            assert not isinstance(written, str), written
            assert not is_refused(name, each)
            assert not is_refused(name, written)
            assert list(SHAPES.unknown(schema, written)) == []
            assert SHAPES.filled(schema, written) == SHAPES.filled(schema, each)

    compared()


def required(schema: Json, value: Json, path: tuple[Any, ...] = ()) -> Iterator[tuple[Any, ...]]:
    """The path of each required field of a value."""
    schema = SHAPES.resolved(schema)
    for kind in schema.get("anyOf", []):
        yield from required(kind, value, path)
    if isinstance(value, dict):
        for name, of in schema.get("properties", {}).items():
            if name in schema.get("required", []):
                yield (*path, name)
            if name in value:
                yield from required(of, value[name], (*path, name))
    elif isinstance(value, list):
        for at, each in enumerate(value):
            yield from required(schema.get("items", {}), each, (*path, at))


def is_there(value: Json, path: tuple[Any, ...]) -> bool:
    """Whether a map has a field, be it nil."""
    *parents, last = path
    for part in parents:
        value = value[part]
    return last in value


def without(value: Json, path: tuple[Any, ...]) -> Json:
    """A copy of a map without one field."""
    first, *rest = path
    if not rest:
        return {key: each for key, each in value.items() if key != first}
    copied = value.copy()
    copied[first] = without(value[first], tuple(rest))
    return copied


def full(schema: Json) -> Json:
    """One value with every field, and one entry in every list."""
    schema = SHAPES.resolved(schema)
    if "anyOf" in schema:
        return full(schema["anyOf"][0])
    if "enum" in schema or "const" in schema:
        return (schema.get("enum") or [schema["const"]])[0]
    if "properties" in schema:
        return {name: full(of) for name, of in schema["properties"].items()}
    if "prefixItems" in schema:
        return [full(each) for each in schema["prefixItems"]]
    if "items" in schema:
        return [full(schema["items"])]
    return b"x" if schema.get("format") == "binary" else SIMPLE[schema.get("type")]


SIMPLE: dict[str | None, Json] = {
    "string": "0" * 32, "object": {}, "boolean": True, "integer": 1, "number": 1,
    None: {"outcome": "passed"},
}  # fmt: skip


@pytest.mark.parametrize(
    ("name", "least"),
    [
        ("worker-hello", 3), ("agent-hello", 4), ("file", 2), ("metric", 4), ("end", 3),
        ("abort", 2), ("step", 2), ("answer", 1), (REPLAY, 65), (PROGRAM, 30),
    ],
)  # fmt: skip
def test_the_agent_always_writes_what_is_required_and_nobody_takes_a_map_without(
    agent_binary: Path, name: str, least: int
) -> None:
    value = full(schema_of(name))
    if name == "step":
        value["messages"] = [[1, b"x"]]
    assert not is_refused(name, value)
    (written,) = written_by_agent(agent_binary, name, [value])
    paths = list(required(schema_of(name), value))
    assert paths == list(required(schema_of(name), written))
    assert len(paths) >= least
    cut = [without(value, path) for path in paths]
    assert [path for path, each in zip(paths, cut, strict=True) if not is_refused(name, each)] == []
    # The struct demands it as well, or writes nil in its place.
    for path, read in zip(paths, written_by_agent(agent_binary, name, cut), strict=True):
        assert isinstance(read, str) or is_there(read, path), path


def test_the_recording_s_head_is_a_file_from_the_agent(agent_binary: Path) -> None:
    (written,) = written_by_agent(agent_binary, "file", [{"name": "a.bag", "size": 7}])
    assert TypeAdapter(FileFromAgent).validate_python(written) == {"name": "a.bag", "size": 7}


@pytest.mark.parametrize("name", [REPLAY, PROGRAM])
def test_the_agent_knows_the_words_of_the_schema_and_no_others(
    agent_binary: Path, name: str
) -> None:
    value, seen = full(schema_of(name)), set()
    for path, words in choices(schema_of(name), value):
        changed = with_value(value, path, "no such word")
        (sentence,) = written_by_agent(agent_binary, name, [changed])
        assert "unknown variant" in sentence, (path, sentence)
        assert set(re.findall(r"`([^`]+)`", sentence)) - {"no such word"} == set(words), path
        seen.add(path[-1])
    kinds = {REPLAY: {"strength", "by", "cause", "what", "ended_by", "name"}}
    assert seen == kinds.get(name, {"engine", "cause", "what", "ended_by"})


def choices(schema: Json, value: Json, path: tuple[Any, ...] = ()) -> Iterator[tuple[Any, Any]]:
    """Each field that has one of some words, and these."""
    schema = SHAPES.resolved(schema)
    for kind in schema.get("anyOf", []):
        yield from choices(kind, value, path)
    if "enum" in schema or "const" in schema:
        yield path, schema.get("enum") or [schema["const"]]
    if isinstance(value, dict):
        for name, of in schema.get("properties", {}).items():
            yield from choices(of, value[name], (*path, name))
    elif isinstance(value, list) and "items" in schema:
        yield from choices(schema["items"], value[0], (*path, 0))


def with_value(value: Json, path: tuple[Any, ...], new: Json) -> Json:
    """A copy of a map with another value in one place."""
    first, *rest = path
    copied = value.copy()
    copied[first] = with_value(value[first], tuple(rest), new) if rest else new
    return copied
