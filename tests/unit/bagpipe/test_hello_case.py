"""The worker's case for HELLO has the shape that its schema gives, with every field."""

from typing import Any

import pytest

from bagpipe.plan.case import Case
from bagpipe.plan.fragments import Window
from bagpipe.run.case_run import RunContext, case_map
from bagpipe.wire.hello_case import hello_case_schema, valid_case
from tests.unit.bagpipe.jobs import make_spec

Json = Any
SCHEMA = hello_case_schema()
STEP = {"trigger": "/scan", "answer": "/out"}


def written() -> Json:
    spec = make_spec(playback={"mode": "lockstep", "steps": [STEP]})
    case = Case("a", "pvc://r/a.bag", "v", Window(0, 1, 2), [], [], 1)
    return case_map(case, RunContext("n/j", spec, {}, "pvc://results/r"))


def missing(schema: Json, value: Json, path: str = "") -> list[str]:
    """The fields of a schema that a case has not, at any depth, and those that no schema names."""
    if "$ref" in schema:
        schema = SCHEMA["$defs"][schema["$ref"].rpartition("/")[2]]
    if isinstance(value, list) and "items" in schema:
        return [name for each in value for name in missing(schema["items"], each, f"{path}[]")]
    if "properties" not in schema:
        return []
    found = [f"{path}.{name}" for name in schema["properties"].keys() ^ value.keys()]
    for name, of in schema["properties"].items():
        found += missing(of, value[name], f"{path}.{name}") if name in value else []
    return found


def test_every_field_is_written_and_no_other() -> None:
    case = written()
    assert valid_case(case) == case
    assert missing(SCHEMA, case) == [".simulator"]


@pytest.mark.parametrize(
    ("changed", "words"),
    [
        ({"simulator": {"publications": []}, "playback": {}}, "plays in lock-step only"),
        ({"engine": "ros3"}, "engine is 'ros3', not ros1 or exec or ros2"),
        ({"stack": {"command": [""]}}, "stack.command is empty"),
        ({"window": [0, 1, 2]}, "valid dictionary"),
    ],
)
def test_what_has_another_shape_is_refused(changed: Json, words: str) -> None:
    with pytest.raises(ValueError, match=words):
        valid_case(written() | changed)
