"""The CRDs' schemas as the fuzzer walks them: every place in them, and valid values for each."""

import random
import re
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import re2
import yaml

from tests.fuzz.manifests.values import Json

ROOT = Path(__file__).parents[3]
EACH = "[]"  # any element of a list
ANY_KEY = "*"  # any key of a map
Step = str
Schema = dict[str, Any]

# Ordinary words, from which those are taken that a field's own rules let pass.
_WORDS = (
    "a", "abc", "x-1", "main", "/tf", "/joint_states", "/a/b", "5s", "100ms", "1m", "20s", "1h",
    "1", "2", "500m", "1Gi", "2Gi", "pvc://recordings/a.bag", "pvc://recordings/pr2/*.bag",
    "pvc://results/out", "file:///mnt/a/b", "s3://bucket/x", "example/image:1", "pose.x",
    "data[0].y", "judge.py", "X", "_v", "x > 0", "30 2 * * *", "*/5 * * * *", "Etc/UTC",
    "Europe/Berlin", "/mnt/data", "{{ x }}", "2026-11-20T04:00:00Z",
)  # fmt: skip
# All of them are date-times to the API server.
_MOMENTS = (
    "2026-11-20T04:00:00Z", "2026-11-20T03:59:00Z", "2026-11-20T04:00:00.123456Z",
    "2026-11-20T05:00:00+01:00", "0000-01-01T00:00:00Z", "9999-12-31T23:59:59Z",
)  # fmt: skip
_POSITIVE = re.compile(r"(?<!!)self[.]matches\((r?)'((?:[^'\\]|\\.)*)'\)")
_PREFIX = re.compile(r"(?<!!)self[.]startsWith\('([^']*)'\)")


@dataclass(frozen=True)
class Place:
    """Somewhere in a manifest: the steps that lead there, and what the schema says of it."""

    steps: tuple[Step, ...]
    type: str

    @property
    def field(self) -> str:
        """The name of the field, also for an element of it."""
        return next((s for s in reversed(self.steps) if s not in {EACH, ANY_KEY}), "")


@cache
def crds() -> dict[str, Schema]:
    """The CRDs of this checkout by their kind."""
    found = [yaml.safe_load(path.read_text()) for path in sorted((ROOT / "crds").glob("*.yaml"))]
    return {crd["spec"]["names"]["kind"]: crd for crd in found}


@cache
def whole(kind: str) -> Schema:
    """The schema of a kind."""
    schema: Schema = crds()[kind]["spec"]["versions"][0]["schema"]["openAPIV3Schema"]
    return schema


def type_of(schema: Schema) -> str:
    """The type that a schema asks for; empty where it asks for none."""
    if schema.get("x-kubernetes-int-or-string"):
        return "string"
    return str(schema.get("type") or "")


def child(schema: Schema, step: Step) -> Schema | None:
    """What a schema says of one step further in; None for a field that it does not know."""
    if step == EACH:
        found = schema.get("items")
    elif step == ANY_KEY or step not in (schema.get("properties") or {}):
        found = schema.get("additionalProperties")
    else:
        found = schema["properties"][step]
    return found if isinstance(found, dict) else None


@cache
def places_of(kind: str, part: str) -> tuple[Place, ...]:
    """Every place of a kind's `spec` or `status`."""
    return tuple(places(whole(kind)["properties"][part]))


def places(schema: Schema, steps: tuple[Step, ...] = ()) -> Iterator[Place]:
    """Every place of a schema below its root, containers too."""
    inner = [*(schema.get("properties") or {})]
    if isinstance(schema.get("items"), dict):
        inner.append(EACH)
    if isinstance(schema.get("additionalProperties"), dict):
        inner.append(ANY_KEY)
    for step in inner:
        below = child(schema, step)
        if below is not None:
            yield Place((*steps, step), type_of(below))
            yield from places(below, (*steps, step))


@cache
def _patterns(rules: tuple[str, ...]) -> tuple[Any, ...]:
    found = []
    for rule in rules:
        for raw, pattern in _POSITIVE.findall(rule)[:1]:
            plain = pattern if raw else pattern.encode().decode("unicode_escape")
            found.append(re2.compile(plain))
        found += [re2.compile("^" + re.escape(word)) for word in _PREFIX.findall(rule)[:1]]
    return tuple(found)


@cache
def _words(rules: tuple[str, ...], longest: int) -> tuple[str, ...]:
    """The ordinary words that a string's rules let pass, as far as patterns say it."""
    patterns = _patterns(rules)
    fit = [w for w in _WORDS if len(w) <= longest and all(p.search(w) for p in patterns)]
    return tuple(fit) or ("a",)


def valid(rng: random.Random, schema: Schema, depth: int = 0) -> Json:
    """A value that the schema takes, but for rules that bind several fields together."""
    if "enum" in schema:
        return rng.choice(schema["enum"])
    make = _VALID.get(type_of(schema))
    if make is None:
        return rng.choice((0.5, "word", [1, 2], {"a": 1}))
    return make(rng, schema, depth)


def _string(rng: random.Random, schema: Schema, _depth: int) -> str:
    if schema.get("format") == "date-time":
        return rng.choice(_MOMENTS)
    rules = tuple(r["rule"] for r in schema.get("x-kubernetes-validations") or [])
    return rng.choice(_words(rules, schema.get("maxLength", 10_000)))


def _integer(rng: random.Random, schema: Schema, _depth: int = 0) -> int:
    low = int(schema.get("minimum", 0)) + bool(schema.get("exclusiveMinimum"))
    high = max(low, int(schema.get("maximum", low + 1_000)))
    bound = rng.random() < 0.2
    return (
        rng.choice((low, high))
        if bound
        else rng.randint(max(low, min(1, high)), min(high, max(low, 1) + 5))
    )


def _array(rng: random.Random, schema: Schema, depth: int) -> list[Json]:
    least = max(schema.get("minItems", 0), 1)
    count = min(rng.randint(least, least + 1), schema.get("maxItems", 99))
    return [valid(rng, schema.get("items") or {}, depth + 1) for _ in range(count)]


def _object(rng: random.Random, schema: Schema, depth: int) -> Json:
    required = schema.get("required") or []
    made = {}
    for name, inner in (schema.get("properties") or {}).items():
        if name in required or rng.random() < 0.15 / (depth + 1):
            made[name] = valid(rng, inner, depth + 1)
    if isinstance(schema.get("additionalProperties"), dict):
        made[rng.choice(("cpu", "memory", "a"))] = valid(
            rng, schema["additionalProperties"], depth + 1
        )
    elif schema.get("x-kubernetes-preserve-unknown-fields"):
        made["/x"] = rng.choice((1, "a", [1.5], {"b": True}))
    return made


_VALID: dict[str, Callable[[random.Random, Schema, int], Json]] = {
    "string": _string,
    "integer": _integer,
    "number": lambda rng, schema, _depth: _integer(rng, schema) + rng.choice((0.0, 0.5)),
    "boolean": lambda rng, _schema, _depth: rng.random() < 0.5,
    "array": _array,
    "object": _object,
}
