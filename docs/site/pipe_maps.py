"""Writes the maps of the pipe: their JSON Schemas, and their tables in docs/reference/binpipe.md.

.venv/bin/python -m docs.site.pipe_maps           write them
.venv/bin/python -m docs.site.pipe_maps --check   say whether they are up to date
"""

import json
import re
import sys
from collections.abc import Iterator, Mapping
from pathlib import Path

from pydantic import TypeAdapter

from bagpipe.engine.exec.result import ProgramResult
from bagpipe.engine.replay_result import ReplayResult
from bagpipe.wire.hello_case import hello_case_schema
from bagpipe.wire.maps.session import (
    Abort,
    AgentHello,
    End,
    FileFromAgent,
    FileToAgent,
    Metric,
    WorkerHello,
)
from bagpipe.wire.maps.shape import Schema
from bagpipe.wire.maps.stack import StackEnd
from bagpipe.wire.maps.turns import Answer, Step
from docs.site.generated import keep

REFERENCE = Path(__file__).parents[1] / "reference"
PAGE = REFERENCE / "binpipe.md"
CASE = REFERENCE / "hello-case.json"
MAPS = REFERENCE / "pipe-maps.json"
# Around each table.
BEGIN = "<!-- {}: written by python -m docs.site.pipe_maps, do not edit up to the end. -->\n"
END = "<!-- The end of what is written. -->\n"
# What has a table of its own, and where: tables that have such a field name it.
APART = {StackEnd.__name__: "[map](#end-of-the-stack)"}


def schemas() -> Schema:
    """One document with every map but HELLO's case: each is found by its name in `$defs`."""
    models = (
        WorkerHello, AgentHello, FileToAgent, FileFromAgent, Metric, End, Abort, Step, Answer,
        StackEnd, ReplayResult, ProgramResult,
    )  # fmt: skip
    inputs = [(model, "validation", TypeAdapter(model)) for model in models]
    found, whole = TypeAdapter.json_schemas(
        inputs,  # type: ignore[arg-type]
        title="Maps of the pipe",
    )
    written: Schema = {"$schema": "https://json-schema.org/draft/2020-12/schema", **whole}
    for model in models:
        written["$defs"].setdefault(model.__name__, found[(model, "validation")])
    return written


def main(words: list[str]) -> int:
    """0 where all is well."""
    case, maps = hello_case_schema(), schemas()
    tables = {name: (schema, maps) for name, schema in maps["$defs"].items()}
    page = with_tables(PAGE.read_text(), tables | {"HelloCase": (case, case)})
    module = "docs.site.pipe_maps"
    stale = [
        keep(path, text, module, words)
        for path, text in ((CASE, as_json(case)), (MAPS, as_json(maps)), (PAGE, page))
    ]
    return max(stale)


def as_json(schema: Schema) -> str:
    """As it is kept."""
    return json.dumps(schema, indent=2) + "\n"


def with_tables(page: str, tables: Mapping[str, tuple[Schema, Schema]]) -> str:
    """The page with its tables as they are now; raises SystemExit where a mark has no end."""
    begin = re.escape(BEGIN).replace(r"\{\}", r"(\w+)")
    marks = begin + "(.*?)" + re.escape(END)
    whole = len(re.findall(marks, page, re.DOTALL))
    if not page.count(END) == len(re.findall(begin, page)) == whole > 0:
        raise SystemExit(f"{PAGE.name}: put the marks of docs/site/pipe_maps.py around each table")

    def table(mark: re.Match[str]) -> str:
        schema, whole = tables[mark[1]]
        rows = ["| field | type | | |", "|---|---|---|---|", *rows_of(schema, whole, "")]
        return BEGIN.format(mark[1]) + "\n" + "\n".join(rows) + "\n\n" + END

    return re.sub(marks, table, page, flags=re.DOTALL)


def rows_of(schema: Schema, whole: Schema, path: str) -> Iterator[str]:
    """A row for each field, those of a map after it, but of one with a table of its own."""
    for name, written in schema.get("properties", {}).items():
        field = resolved(written, whole)
        place = f"{path}{name}"
        there = presence(name, field, schema)
        yield f"| `{place}` | {type_of(field, whole)} | {there} | {field['description']} |"
        field, _ = without_nil(field, whole)
        if field.get("title") in APART:
            continue
        items = resolved(field.get("items", {}), whole)
        yield from rows_of(field, whole, f"{place}.")
        yield from rows_of(items, whole, f"{place}[].")
        if isinstance(values := field.get("additionalProperties"), dict):
            yield from rows_of(resolved(values, whole), whole, f"{place}.*.")


def resolved(schema: Schema, whole: Schema) -> Schema:
    """A schema without a reference; what is written beside it goes first."""
    if "$ref" not in schema:
        return schema
    found: Schema = whole["$defs"][schema["$ref"].rpartition("/")[2]]
    return found | {key: value for key, value in schema.items() if key != "$ref"}


def without_nil(field: Schema, whole: Schema) -> tuple[Schema, bool]:
    """What a field has where it is not nil, and whether it may be nil."""
    kinds = field.get("anyOf", [])
    others = [kind for kind in kinds if kind != {"type": "null"}]
    if len(others) == 1 and len(kinds) == 2:
        return resolved(others[0], whole), True
    return field, False


def type_of(field: Schema, whole: Schema) -> str:
    """In words."""
    field, may_be_nil = without_nil(field, whole)
    return in_words(field, whole) + (", or nil" if may_be_nil else "")


def in_words(field: Schema, whole: Schema) -> str:
    """Of a field that is not nil."""
    if "enum" in field or "const" in field:
        return " or ".join(f"`{value}`" for value in field.get("enum") or [field["const"]])
    if "anyOf" in field:
        return " or ".join(type_of(resolved(kind, whole), whole) for kind in field["anyOf"])
    if field.get("title") in APART:
        return APART[field["title"]]
    if field.get("type") == "array":
        return list_in_words(field, whole)
    return simple_in_words(field)


def simple_in_words(field: Schema) -> str:
    """Of a map, text, bytes or a number."""
    kind = field.get("type", "anything")
    if kind == "string" and field.get("format") == "binary":
        return "bytes"
    if kind == "number" and "maximum" in field:
        return f"number, {field['minimum']} to {field['maximum']:.0f}"
    if kind == "number" and "minimum" in field:
        return f"number from {field['minimum']}"
    return "map" if kind == "object" else str(kind)


def list_in_words(field: Schema, whole: Schema) -> str:
    """Of one kind, or of lists with a kind for each place."""
    items = resolved(field.get("items", {}), whole)
    if "prefixItems" in items and items.get("type") == "array":
        places = [type_of(resolved(kind, whole), whole) for kind in items["prefixItems"]]
        return f"list of [{', '.join(places)}]"
    return f"list of {items.get('type', 'map').replace('object', 'map')}s"


def presence(name: str, field: Schema, schema: Schema) -> str:
    """Whether it must be there, or what is meant without it."""
    if name in schema.get("required", []):
        return "required"
    if "default" not in field:
        return "optional"
    return "nil" if field["default"] is None else f"`{json.dumps(field['default'])}`"


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
