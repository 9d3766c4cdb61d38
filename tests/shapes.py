"""Random values of a JSON Schema, for tests that send them through the agent's structs."""

import copy
from collections.abc import Callable, Iterator
from typing import Any

from hypothesis import strategies as st

Json = Any
Strategy = st.SearchStrategy[Any]

# What MessagePack can say and JSON too.
ANYTHING: Strategy = st.recursive(
    st.none() | st.booleans() | st.integers(-(2**63), 2**64 - 1) | st.text(max_size=5)
    | st.floats(allow_nan=False, allow_infinity=False),
    lambda inner: st.lists(inner, max_size=2)
    | st.dictionaries(st.text(max_size=3), inner, max_size=2),
    max_leaves=4,
)  # fmt: skip


class Shapes:
    """The shapes of one document: `whole` has what its references name."""

    def __init__(self, whole: Json) -> None:
        self._whole = whole

    def resolved(self, schema: Json) -> Json:
        """A schema without a reference."""
        if "$ref" not in schema:
            return schema
        return self._whole["$defs"][schema["$ref"].rpartition("/")[2]] | {
            key: value for key, value in schema.items() if key != "$ref"
        }

    def allowed(self, schema: Json) -> Strategy:
        """Values that a schema allows, as far as MessagePack can say them."""
        schema = self.resolved(schema)
        if "anyOf" in schema:
            return st.one_of([self.allowed(each) for each in schema["anyOf"]])
        if "enum" in schema or "const" in schema:
            return st.sampled_from(schema.get("enum") or [schema["const"]])
        match schema.get("type"):
            case "object":
                return self._maps(schema)
            case "array":
                return self._lists(schema)
            case kind:
                return simple(kind, schema)

    def filled(self, schema: Json, value: Json) -> Json:
        """A value with the schema's defaults, and without what the schema does not know."""
        schema = self.resolved(schema)
        if "anyOf" in schema and value is not None:
            (schema,) = (each for each in schema["anyOf"] if each != {"type": "null"})
            return self.filled(schema, value)
        if schema.get("type") == "array" and "items" in schema:
            return [self.filled(schema["items"], each) for each in value]
        if schema.get("type") == "number":
            return float(value)
        if "properties" not in schema:
            values = schema.get("additionalProperties")
            if isinstance(value, dict) and isinstance(values, dict):
                return {name: self.filled(values, each) for name, each in value.items()}
            return value
        return {
            name: self.filled(of, value.get(name, copy.deepcopy(of.get("default"))))
            for name, of in schema["properties"].items()
            if name in value or "default" in self.resolved(of)
        }

    def unknown(self, schema: Json, value: Json, path: str = "") -> Iterator[str]:
        """The fields of a value that its schema does not name, at any depth."""
        schema = self.resolved(schema)
        for kind in schema.get("anyOf", []):
            yield from self.unknown(kind, value, path)
        if isinstance(value, dict) and "properties" in schema:
            for name, each in value.items():
                if name not in schema["properties"]:
                    yield f"{path}.{name}"
                else:
                    yield from self.unknown(schema["properties"][name], each, f"{path}.{name}")
        elif isinstance(value, dict) and isinstance(schema.get("additionalProperties"), dict):
            for name, each in value.items():
                yield from self.unknown(schema["additionalProperties"], each, f"{path}.{name}")
        elif isinstance(value, list) and "items" in schema:
            for each in value:
                yield from self.unknown(schema["items"], each, f"{path}[]")

    def _maps(self, schema: Json) -> Strategy:
        if "properties" not in schema:
            each = schema["additionalProperties"]
            values = ANYTHING if each is True else self.allowed(each)
            return st.dictionaries(st.text(max_size=5), values, max_size=3)
        # Fields of a later version, which the schema allows everywhere.
        assert schema["additionalProperties"] is True
        later = st.dictionaries(st.text(max_size=5).map("later_{}".format), ANYTHING, max_size=1)
        return st.builds(dict.__or__, later, self._known(schema))

    def _known(self, schema: Json) -> Strategy:
        required = set(schema.get("required", []))
        fields = {name: self.allowed(of) for name, of in schema["properties"].items()}
        return st.fixed_dictionaries(
            {name: of for name, of in fields.items() if name in required},
            optional={name: of for name, of in fields.items() if name not in required},
        )

    def _lists(self, schema: Json) -> Strategy:
        first = [self.allowed(each) for each in schema.get("prefixItems", [])]
        if "items" not in schema:
            return st.tuples(*first).map(list)
        each, least = self.allowed(schema["items"]), schema.get("minItems", 0)
        if not first:
            return st.lists(each, min_size=least, max_size=3)
        return st.builds(
            lambda begun, more: [*begun, *more], st.tuples(*first), st.lists(each, max_size=3)
        )


def simple(kind: str | None, schema: Json) -> Strategy:
    """What is neither a map nor a list."""
    if schema.get("format") == "binary":
        return st.binary(max_size=20)
    if "pattern" in schema:
        return st.from_regex(schema["pattern"].replace("$", r"\Z"))
    return OF_TYPE[kind](schema)


def numbers(schema: Json) -> Strategy:
    """Floats, and small integers, which are as good."""
    low, high = schema.get("minimum"), schema.get("maximum")
    return st.integers(0, 1000) | st.floats(low, high, allow_nan=False, allow_infinity=False)


OF_TYPE: dict[str | None, Callable[[Json], Strategy]] = {
    "number": numbers,
    "string": lambda schema: st.text(min_size=schema.get("minLength", 0), max_size=20),
    "integer": lambda schema: st.integers(schema["minimum"], schema["exclusiveMaximum"] - 1),
    "boolean": lambda _: st.booleans(),
    "null": lambda _: st.none(),
    None: lambda _: ANYTHING,
}
