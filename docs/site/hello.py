"""Writes the shape of HELLO's case: its JSON Schema, and its table in docs/reference/binpipe.md.

.venv/bin/python -m docs.site.hello           write them
.venv/bin/python -m docs.site.hello --check   say whether they are up to date
"""

import json
import sys
from collections.abc import Iterator
from pathlib import Path

from bagpipe.wire.hello_case import Schema, hello_case_schema
from docs.site.generated import keep

REFERENCE = Path(__file__).parents[1] / "reference"
PAGE = REFERENCE / "binpipe.md"
SCHEMA = REFERENCE / "hello-case.json"
# Around the table.
BEGIN = "<!-- Written by python -m docs.site.hello: do not edit up to the end. -->\n"
END = "<!-- The end of what is written. -->\n"


def main(words: list[str]) -> int:
    """0 where all is well."""
    schema = hello_case_schema()
    text = json.dumps(schema, indent=2) + "\n"
    stale = keep(SCHEMA, text, "docs.site.hello", words)
    return stale | keep(PAGE, with_table(PAGE.read_text(), schema), "docs.site.hello", words)


def with_table(page: str, schema: Schema) -> str:
    """The page with its table as it is now; raises SystemExit without marks."""
    if page.count(BEGIN) != 1 or page.count(END) != 1:
        raise SystemExit(f"{PAGE.name}: put the marks of docs/site/hello.py around the table")
    head, _, rest = page.partition(BEGIN)
    rows = ["| field | type | | |", "|---|---|---|---|", *rows_of(schema, schema, "")]
    return head + BEGIN + "\n" + "\n".join(rows) + "\n\n" + END + rest.partition(END)[2]


def rows_of(schema: Schema, whole: Schema, path: str) -> Iterator[str]:
    """A row for each field, those of a map after it."""
    for name, written in schema.get("properties", {}).items():
        field = resolved(written, whole)
        place = f"{path}{name}"
        there = presence(name, field, schema)
        yield f"| `{place}` | {type_of(field)} | {there} | {field['description']} |"
        items = resolved(field.get("items", {}), whole)
        yield from rows_of(field, whole, f"{place}.")
        yield from rows_of(items, whole, f"{place}[].")


def resolved(schema: Schema, whole: Schema) -> Schema:
    """A schema without a reference; what is written beside it goes first."""
    if "$ref" not in schema:
        return schema
    found: Schema = whole["$defs"][schema["$ref"].rpartition("/")[2]]
    return found | {key: value for key, value in schema.items() if key != "$ref"}


def type_of(field: Schema) -> str:
    """In words."""
    if "enum" in field:
        return " or ".join(f"`{value}`" for value in field["enum"])
    if field.get("type") == "array":
        return f"list of {field['items'].get('type', 'map')}s"
    if field.get("type") == "object":
        return "map"
    if field["type"] == "number" and "maximum" in field:
        return f"number, {field['minimum']} to {field['maximum']:.0f}"
    return str(field["type"])


def presence(name: str, field: Schema, schema: Schema) -> str:
    """Whether it must be there, or what is meant without it."""
    if name in schema.get("required", []):
        return "required"
    return f"`{json.dumps(field['default'])}`" if "default" in field else "optional"


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
