"""Writes what is derived from the CRDs: the chart's copies and the pages in docs/reference.

    python3 crds/generate.py           write them
    python3 crds/generate.py --check   say whether they are up to date

The chart has a copy and not a symbolic link, since a chart must work when it is packaged alone,
and Helm warns about links with every command. A SimulationSchedule holds a whole job's spec, which
is written once, in simulationjobs.yaml, and put into its CRD here. What follows from the engines
and the sources that are installed is put into simulationjobs.yaml itself.
"""

import re
import sys
import textwrap
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import yaml

from bagpipe.engine_fields import EngineFields, engine_names, fields_of
from bagpipe.source_fields import SourceFields, source_fields, source_names

HERE = Path(__file__).resolve().parent
JOBS = HERE / "simulationjobs.yaml"
SCHEDULES = HERE / "simulationschedules.yaml"
CHART_FILES = HERE.parent / "charts" / "bagpipe" / "files"
REFERENCE = HERE.parent / "docs" / "reference"

# Around the job's spec in simulationschedules.yaml.
BEGIN = "# Generated from simulationjobs.yaml: do not edit up to the end.\n"
END = "# The end of what is generated.\n"
# Around the keys of added sources in simulationjobs.yaml.
BEGIN_ADDED = "# Sources that are added, as generate.py writes them: do not edit up to the end.\n"
END_ADDED = "# The end of what is added.\n"
# Before the names of the engines: the end of the description of stack.engine.
ENUM = """\
so that any other simulator can take the place of ROS.
                    enum: ["""

Schema = dict[str, Any]

HEAD = """# {kind}

Generated from [crds/{plural}.yaml](../../crds/{plural}.yaml) by `crds/generate.py`; do
not edit. `kubectl explain {short}.spec` says the same in the terminal.

API version `{group}/{version}`, kind `{kind}`, short name `{short}`, namespaced.

{description}

{more}
"""
MORE_OF_JOBS = """\
`kubectl wait --for=condition=Passed simjob/<name>` is the gate: it ends well when the job has ended
with the verdict Passed. Complete says only that the job could be run; exactly one of the conditions
Complete and Failed becomes True. One change of a spec is not noticed by the API server:
a parameter that gets another name. It has no effect, since a job's description is fixed when it
starts."""
MORE_OF_SCHEDULES = """\
[Schedule jobs](../tasks/schedules.md) shows one. `kubectl wait
--for=condition=Ready simschedule/<name>` waits until the operator has understood it. The spec of
`jobTemplate` is that of a [SimulationJob](simulationjob.md), with all its fields and rules; only
what forbids changes does not hold here, since a change is for the jobs to come."""


def fields(schema: Schema, path: str) -> Iterator[tuple[str, Schema, bool]]:
    """Every field below a schema, depth first: its path, its schema, whether it is required."""
    required = set(schema.get("required") or [])
    for name, field in (schema.get("properties") or {}).items():
        below = f"{path}.{name}" if path else name
        yield below, field, name in required
        yield from fields(field, below)
        items, values = field.get("items"), field.get("additionalProperties")
        if isinstance(items, dict):
            yield from fields(items, f"{below}[]")
        if isinstance(values, dict):
            yield from fields(values, f"{below}.*")


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


def template_spec(schema: Schema) -> Schema:
    """A job's spec as it stands in a template: what refuses changes of it is left out."""
    kept = {key: value for key, value in schema.items() if key != "x-kubernetes-validations"}
    rules_ = schema.get("x-kubernetes-validations") or []
    lasting = [rule for rule in rules_ if "oldSelf" not in rule["rule"]]
    if lasting:
        kept["x-kubernetes-validations"] = lasting
    for key in ("items", "additionalProperties"):
        if isinstance(kept.get(key), dict):
            kept[key] = template_spec(kept[key])
    if "properties" in kept:
        kept["properties"] = {k: template_spec(v) for k, v in kept["properties"].items()}
    return kept


def schema_of(crd: Schema) -> Schema:
    """The schema of a CRD's one version."""
    schema: Schema = crd["spec"]["versions"][0]["schema"]["openAPIV3Schema"]
    return schema


def with_engines(text: str, engines: dict[str, EngineFields]) -> str:
    """The CRD of jobs with the engines that there are, and what they take, in its rules.

    What an engine refuses beyond that is refused by the operator.
    """
    files = [name for name, fields in engines.items() if "files" in fields.sources]
    sequences = [name for name, fields in engines.items() if "sequence" in fields.sources]
    simulated = [name for name, fields in engines.items() if "simulator" in fields.sources]
    unrecorded = [name for name, fields in engines.items() if "record" not in fields.needed]
    named = "has(self.stack.engine) && "
    for before, names, after in (
        (f'"!has(self.source.files) || ({named}', one_of(files), ')"'),
        ('"source.files are for stack.engine: ', " or ".join(files), ", which reads"),
        ('"!has(self.source.sequence) || !has(self.stack.engine) || ', one_of(sequences), '"'),
        ('"source.sequence is for stack.engine: ', " or ".join(sequences), ": write"),
        ('"!has(self.source.simulator) || !has(self.stack.engine) || ', one_of(simulated), '"'),
        ('"source.simulator is for stack.engine: ', " or ".join(simulated), ": write"),
        (f'"has(self.record) || ({named}', one_of(unrecorded), ')"'),
        ('"record is missing, and only stack.engine: ', " or ".join(unrecorded), " goes without"),
        (ENUM, ", ".join(engines), "]"),
    ):
        text = between(text, before, names, after)
    return text


def with_sources(text: str, sources: dict[str, SourceFields]) -> str:
    """The CRD of jobs with the keys of the sources that there are, and the rule that one is there.

    Raises SystemExit for a source of which neither the file nor its folder has a schema.
    """
    *most, last = sources
    first, *others = (f"has(self.{name})" for name in sources)
    for before, names, after in (
        (f'- rule: "[{first}, ', ", ".join(others), "].exists_one("),
        ('"source needs one of ', f"{', '.join(most)} and {last}", ": write for example bags"),
    ):
        text = between(text, before, names, after)
    added = {name: dict(fields.schema) for name, fields in sources.items() if fields.schema}
    text = marked(text, JOBS.name, BEGIN_ADDED, END_ADDED, added)
    known = schema_of(yaml.safe_load(text))["properties"]["spec"]["properties"]["source"]
    if lacking := [name for name in sources if name not in known["properties"]]:
        raise SystemExit(f"source.{lacking[0]} has no schema: write one into its FIELDS")
    return text


def one_of(engines: list[str]) -> str:
    """A condition in CEL."""
    if len(engines) == 1:
        return f"self.stack.engine == '{engines[0]}'"
    return f"self.stack.engine in {engines}"


def between(text: str, before: str, new: str, after: str) -> str:
    """The text with this part of one line replaced; raises SystemExit unless it is there once."""
    head, *tails = text.split(before)
    if len(tails) != 1 or after not in tails[0].partition("\n")[0]:
        raise SystemExit(f"{JOBS.name}: generate.py looks for one line with {before}...{after}")
    return head + before + new + tails[0][tails[0].index(after) :]


def with_job_spec(text: str, jobs: Schema) -> str:
    """The CRD of schedules with a job's spec as it is now. Raises SystemExit without marks."""
    spec = template_spec(schema_of(jobs)["properties"]["spec"])
    spec["description"] = "The spec of every job, as of a SimulationJob."
    return marked(text, SCHEDULES.name, BEGIN, END, {"spec": spec})


def marked(text: str, name: str, begin: str, end: str, schemas: Schema) -> str:
    """The text with these between the marks, as deep; raises SystemExit unless each is there once.

    `name` is the file's.
    """
    if text.count(begin) != 1 or text.count(end) != 1:
        raise SystemExit(f"{name}: write these marks of generate.py once:\n{begin}{end}")
    head, _, rest = text.partition(begin)
    indent = head.rpartition("\n")[2]
    block = (
        yaml.dump(schemas, Dumper=_Dumper, sort_keys=False, width=100, allow_unicode=True)
        if schemas
        else ""
    )
    return head + begin + textwrap.indent(block, indent) + indent + end + rest.partition(end)[2]


class _Dumper(yaml.SafeDumper):
    """Quotes what kubectl and Helm, whose YAML is 1.1, would take for true or false."""


_Dumper.add_implicit_resolver("tag:yaml.org,2002:bool", re.compile("^[yYnN]$"), list("yYnN"))


def reference(crd: Schema, more: str, shortened: str = "") -> str:
    """The whole page; fields below the path `shortened` are described on another one."""
    names, version = crd["spec"]["names"], crd["spec"]["versions"][0]
    schema = schema_of(crd)
    properties = schema["properties"]
    head = HEAD.format(
        group=crd["spec"]["group"],
        version=version["name"],
        kind=names["kind"],
        plural=names["plural"],
        short=names["shortNames"][0],
        more=more,
        description=prose(schema["description"]),
    )
    parts = [head, "## Names\n", *(f"- {prose(message)}" for message in rules(schema))]
    for part in ("spec", "status"):
        top = properties[part]
        parts += [f"\n## {part}\n", prose(top["description"]) + "\n"]
        parts += [f"- {prose(message)}" for message in rules(top)]
        parts += [""] if rules(top) else []
        described = fields(top, part)
        parts += [entry(*f) for f in described if not shortened or not f[0].startswith(shortened)]
    return "\n".join(parts).rstrip() + "\n"


def derived() -> dict[Path, str]:
    """What each derived file should hold."""
    text = with_engines(JOBS.read_text(), {name: fields_of(name) for name in engine_names()})
    text = with_sources(text, {name: source_fields(name) for name in source_names()})
    jobs = yaml.safe_load(text)
    schedules = with_job_spec(SCHEDULES.read_text(), jobs)
    return {
        JOBS: text,
        CHART_FILES / JOBS.name: text,
        SCHEDULES: schedules,
        CHART_FILES / SCHEDULES.name: schedules,
        REFERENCE / "simulationjob.md": reference(jobs, MORE_OF_JOBS),
        REFERENCE / "simulationschedule.md": reference(
            yaml.safe_load(schedules), MORE_OF_SCHEDULES, "spec.jobTemplate.spec."
        ),
    }


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
