"""Writes what is derived from the CRD: the chart's copy and docs/reference/simulationjob.md.

    python3 crds/generate.py           write both
    python3 crds/generate.py --check   say whether both are up to date

The chart has a copy and not a symbolic link, since a chart must work when it is packaged alone,
and Helm warns about links with every command.
"""

import re
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import yaml

HERE = Path(__file__).resolve().parent
CRD = HERE / "simulationjobs.yaml"
CHART_COPY = HERE.parent / "charts" / "bagpipe" / "files" / "simulationjobs.yaml"
REFERENCE = HERE.parent / "docs" / "reference" / "simulationjob.md"

Schema = dict[str, Any]

HEAD = """# SimulationJob

Generated from [crds/simulationjobs.yaml](../../crds/simulationjobs.yaml) by `crds/generate.py`; do
not edit. `kubectl explain simjob.spec` says the same in the terminal.

API version `{group}/{version}`, kind `{kind}`, short name `{short}`, namespaced.

{description}

`kubectl wait --for=condition=Complete simjob/<name>` waits for a job's good end; exactly one of the
conditions Complete and Failed becomes True. One change of a spec is not noticed by the API server:
a parameter that gets another name. It has no effect, since a job's description is fixed when it
starts.
"""


def fields(schema: Schema, path: str) -> Iterator[tuple[str, Schema, bool]]:
    """Every field below a schema, depth first: its path, its schema, whether it is required."""
    required = set(schema.get("required") or [])
    for name, field in (schema.get("properties") or {}).items():
        below = f"{path}.{name}" if path else name
        yield below, field, name in required
        yield from fields(field, below)
        items = field.get("items")
        if isinstance(items, dict):
            yield from fields(items, f"{below}[]")


def type_name(schema: Schema) -> str:
    """The type as a reader would say it."""
    if schema.get("x-kubernetes-int-or-string"):
        return "quantity"
    if schema.get("type") == "array":
        return f"list of {type_name(schema['items'])}s"
    if schema.get("additionalProperties"):
        return f"map to {type_name(schema['additionalProperties'])}"
    if schema.get("x-kubernetes-preserve-unknown-fields"):
        return "map to anything"
    return str(schema.get("type", "anything"))


def rules(schema: Schema) -> list[str]:
    """What the API server says when a value is refused; rules of a list's items are among them."""
    own = [rule["message"] for rule in schema.get("x-kubernetes-validations") or []]
    items = schema.get("items")
    below = rules(items) if isinstance(items, dict) and not items.get("properties") else []
    return own + below


def prose(text: str) -> str:
    """Text of the CRD as Markdown: nothing in it is meant as markup."""
    return re.sub(r"([<>*_\\[\]])", r"\\\1", text)


def entry(path: str, schema: Schema, required: bool) -> str:
    """One field of the page."""
    facts = [type_name(schema)]
    if required:
        facts.append("required")
    if "default" in schema and schema["default"] != {}:
        shown = schema["default"]
        facts.append("default empty" if shown == "" else f"default `{shown}`")
    if schema.get("enum"):
        facts.append("one of " + ", ".join(f"`{v}`" if v else "nothing" for v in schema["enum"]))
    lines = [
        f"### `{path}`",
        "",
        f"*{', '.join(facts)}*",
        "",
        *prose(schema["description"]).split("\n"),
    ]
    if rules(schema):
        lines += [
            "",
            "Refused otherwise:",
            "",
            *(f"- {prose(message)}" for message in rules(schema)),
        ]
    return "\n".join(lines) + "\n"


def reference(crd: Schema) -> str:
    """The whole page."""
    names, version = crd["spec"]["names"], crd["spec"]["versions"][0]
    schema = version["schema"]["openAPIV3Schema"]
    properties = schema["properties"]
    head = HEAD.format(
        group=crd["spec"]["group"],
        version=version["name"],
        kind=names["kind"],
        short=names["shortNames"][0],
        description=prose(schema["description"]),
    )
    parts = [head, "## Names\n", *(f"- {prose(message)}" for message in rules(schema))]
    for part in ("spec", "status"):
        top = properties[part]
        parts += [f"\n## {part}\n", prose(top["description"]) + "\n"]
        parts += [f"- {prose(message)}" for message in rules(top)]
        parts += [""] if rules(top) else []
        parts += [entry(*field) for field in fields(top, part)]
    return "\n".join(parts).rstrip() + "\n"


def derived() -> dict[Path, str]:
    """What each derived file should hold."""
    text = CRD.read_text()
    return {CHART_COPY: text, REFERENCE: reference(yaml.safe_load(text))}


def main() -> int:
    """Writes, or with --check compares; the exit status says whether all was up to date."""
    stale = [
        path for path, text in derived().items() if not path.exists() or path.read_text() != text
    ]
    if "--check" in sys.argv[1:]:
        for path in stale:
            print(f"{path.name} is not up to date: run python3 crds/generate.py", file=sys.stderr)
        return 1 if stale else 0
    for path in stale:
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(derived()[path])
        print(f"wrote {path}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
