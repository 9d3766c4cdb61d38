"""What the API server would say of a value, without one: a structural schema and its CEL rules.

As far as this project's CRDs go: types, bounds, lengths, enums, required and unknown fields,
defaults, and rules without `oldSelf`.
"""

from collections.abc import Iterator
from typing import Any

import cel

Schema = dict[str, Any]

_TYPES: dict[str, tuple[type, ...]] = {
    "string": (str,),
    "boolean": (bool,),
    "integer": (int,),
    "number": (int, float),
    "array": (list,),
    "object": (dict,),
}


def refusals(schema: Schema, value: Any, path: str = "") -> list[str]:
    """What the API server says; nothing for a value that it takes."""
    structural = list(_structural(schema, value, path))
    # Rules are looked at only where the structure is right, and after defaults are filled in.
    return structural or list(_by_rules(schema, defaulted(schema, value), path))


def defaulted(schema: Schema, value: Any) -> Any:
    """The value with the schema's defaults, and its numbers as CEL sees them."""
    kind = schema.get("type")
    if kind == "number":
        return float(value)
    if kind == "array":
        return [defaulted(schema["items"], item) for item in value]
    if kind != "object" or "properties" not in schema:
        return value
    filled = {
        name: field["default"]
        for name, field in schema["properties"].items()
        if "default" in field and name not in value
    }
    return {
        name: defaulted(schema["properties"][name], item) for name, item in (filled | value).items()
    }


def _structural(schema: Schema, value: Any, path: str) -> Iterator[str]:
    kind = schema["type"]
    if type(value) not in _TYPES[kind]:  # a boolean is an integer to isinstance
        yield f"{path}: must be of type {kind}"
    elif "enum" in schema and value not in schema["enum"]:
        yield f"{path}: Unsupported value: {value!r}"
    elif kind in {"integer", "number"}:
        yield from _bounds(schema, value, path)
    elif kind == "string" and len(value) > schema.get("maxLength", len(value)):
        yield f"{path}: Too long"
    elif kind == "array":
        if not schema.get("minItems", 0) <= len(value) <= schema.get("maxItems", len(value)):
            yield f"{path}: a wrong number of items"
        for number, item in enumerate(value):
            yield from _structural(schema["items"], item, f"{path}[{number}]")
    elif kind == "object" and "properties" in schema:
        yield from _fields(schema, value, path)


def _fields(schema: Schema, value: dict[str, Any], path: str) -> Iterator[str]:
    for name in schema.get("required", []):
        if name not in value:
            yield f"{path}.{name}: Required value"
    for name, item in value.items():
        if name not in schema["properties"]:
            yield f"{path}.{name}: unknown field"
        else:
            yield from _structural(schema["properties"][name], item, f"{path}.{name}")


def _bounds(schema: Schema, value: float, path: str) -> Iterator[str]:
    least, most = schema.get("minimum"), schema.get("maximum")
    if least is not None and (value < least or (schema.get("exclusiveMinimum") and value == least)):
        yield f"{path}: must be greater than {least}"
    if most is not None and value > most:
        yield f"{path}: must be at most {most}"


def _by_rules(schema: Schema, value: Any, path: str) -> Iterator[str]:
    for rule in schema.get("x-kubernetes-validations") or []:
        if "oldSelf" not in rule["rule"] and not _holds(rule["rule"], value):
            yield f"{path}: {rule['message']}"
    if schema.get("type") == "array":
        for number, item in enumerate(value):
            yield from _by_rules(schema["items"], item, f"{path}[{number}]")
    for name, field in (schema.get("properties") or {}).items():
        if name in value:
            yield from _by_rules(field, value[name], f"{path}.{name}")


def _holds(rule: str, value: Any) -> bool:
    answer = cel.compile(rule).execute({"self": value})
    if not isinstance(answer, bool):
        raise TypeError(f"{rule} gives {answer!r}")
    return answer
