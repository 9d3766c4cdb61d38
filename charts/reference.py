"""Writes docs/reference/chart-values.md and namespace-values.md from the charts' values.

    .venv/bin/python charts/reference.py           write them
    .venv/bin/python charts/reference.py --check   say whether they are up to date

The text of a value is the comment above it in values.yaml, and what it may be is in
values.schema.json; a value without a comment or without a schema is refused.
"""

import json
import re
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import yaml

ROOT = Path(__file__).resolve().parents[1]
HEAD = """\
# {title}

Generated from [values.yaml](../../charts/{name}/values.yaml) and
[values.schema.json](../../charts/{name}/values.schema.json) by `charts/reference.py`; do not edit.

{command}

Helm refuses a value that is not here, or not as it is described here.
"""

Schema = dict[str, Any]


@dataclass(frozen=True)
class Chart:
    """A chart, its page, and how the page begins."""

    name: str
    page: Path
    title: str
    command: str

    @property
    def folder(self) -> Path:
        """Where it lies."""
        return ROOT / "charts" / self.name


BAGPIPE = Chart(
    "bagpipe",
    ROOT / "docs/reference/chart-values.md",
    "The chart's values",
    "    helm upgrade --install bagpipe charts/bagpipe --namespace bagpipe-system"
    " --create-namespace \\\n      -f your-values.yaml --wait",
)
NAMESPACE = Chart(
    "bagpipe-namespace",
    ROOT / "docs/reference/namespace-values.md",
    "The values of the chart bagpipe-namespace",
    "    helm upgrade --install bagpipe-namespace charts/bagpipe-namespace --namespace lanes"
    " \\\n      -f your-values.yaml\n\n"
    "It makes [one namespace](../operations/namespaces.md) ready for jobs.",
)
CHARTS = (BAGPIPE, NAMESPACE)


@dataclass(frozen=True)
class Value:
    """A value of the chart: its path, its comment, its default as written, whether it has parts."""

    path: str
    text: str
    default: str
    group: bool


def values(source: str) -> Iterator[Value]:
    """Every value in the text of values.yaml, in its order; raises SystemExit without a comment."""
    root = yaml.compose(source, Loader=yaml.SafeLoader)
    if not isinstance(root, yaml.MappingNode):
        raise SystemExit("values.yaml: its top is no map")
    yield from _below(root, "", source)


def schema_at(schema: Schema, path: str) -> Schema:
    """The schema of a value, with its reference followed; raises SystemExit where there is none."""
    found = schema
    for name in path.split("."):
        if name not in found.get("properties", {}):
            raise SystemExit(f"{path}: add it to values.schema.json")
        found = _followed(schema, found["properties"][name])
    return found


def facts(schema: Schema, whole: Schema) -> str:
    """What a value may be, in words."""
    if "enum" in schema:
        return "one of " + ", ".join(f"`{word}`" for word in schema["enum"])
    words = [_kind(schema, whole)]
    low, high = schema.get("minimum"), schema.get("maximum")
    if low is not None and high is not None:
        words.append(f"{low} to {high}")
    elif low is not None:
        words.append(f"at least {low}")
    if "exclusiveMinimum" in schema:
        words.append(f"above {schema['exclusiveMinimum']}")
    if schema.get("minLength"):
        words.append("not empty")
    if "pattern" in schema:
        words.append(f"matches `{schema['pattern']}`")
    return ", ".join(words)


def page(chart: Chart) -> str:
    """The whole page, from the chart's files."""
    whole = json.loads((chart.folder / "values.schema.json").read_text())
    parts = [HEAD.format(title=chart.title, name=chart.name, command=chart.command)]
    for value in values((chart.folder / "values.yaml").read_text()):
        schema = schema_at(whole, value.path)
        level = "##" if "." not in value.path else "###"
        parts.append(f"{level} `{value.path}`\n")
        if not value.group:
            parts.append(f"*{facts(schema, whole)}, default `{value.default}`*\n")
        parts.append(f"{_prose(value.text)}\n")
    return "\n".join(parts)


def _below(node: yaml.MappingNode, path: str, source: str) -> Iterator[Value]:
    lines = source.splitlines()
    for key, value in node.value:
        name = f"{path}.{key.value}" if path else str(key.value)
        text = _comment(lines, key.start_mark.line)
        if not text:
            line = key.start_mark.line + 1
            raise SystemExit(f"values.yaml, line {line}: say above {name} what it is")
        group = isinstance(value, yaml.MappingNode) and not value.flow_style
        default = source[value.start_mark.index : value.end_mark.index].strip()
        yield Value(name, text, default, group)
        if group:
            yield from _below(value, name, source)


def _comment(lines: list[str], line: int) -> str:
    found: list[str] = []
    while line and lines[line - 1].lstrip().startswith("#"):
        line -= 1
        found.insert(0, lines[line].strip().removeprefix("#").strip())
    return "\n".join(found)


def _followed(whole: Schema, schema: Schema) -> Schema:
    name = schema.get("$ref", "").rpartition("/")[2]
    return whole["definitions"][name] if name else schema


def _kind(schema: Schema, whole: Schema) -> str:
    if schema.get("type") == "array":
        items = _followed(whole, schema.get("items", {}))
        return f"list of {items.get('type', 'anything')}s"
    if isinstance(schema.get("additionalProperties"), dict):
        return "map"
    return str(schema.get("type", "anything"))


def _prose(text: str) -> str:
    return re.sub(r"([<>*_\\[\]])", r"\\\1", text)


def main() -> int:
    """Writes, or with --check compares; the exit status says whether the pages were up to date."""
    wanted = {chart.page: page(chart) for chart in CHARTS}
    if "--check" not in sys.argv[1:]:
        for path, text in wanted.items():
            path.write_text(text)
        return 0
    stale = [p.name for p, text in wanted.items() if not p.is_file() or p.read_text() != text]
    for name in stale:
        print(f"{name} is not up to date: run charts/reference.py", file=sys.stderr)
    return 1 if stale else 0


if __name__ == "__main__":
    sys.exit(main())
