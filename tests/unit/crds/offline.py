"""What the API server would say of a value, without one: a structural schema and its CEL rules.

As far as this project's CRDs go: types, bounds, lengths, enums, lists without repetition, required
and unknown fields, defaults, and rules without `oldSelf`.
"""

import re
from collections.abc import Callable, Iterator
from typing import Any

import cel
import re2

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
    if schema.get("x-kubernetes-int-or-string"):
        if type(value) not in (int, str):
            yield f"{path}: must be of type integer or string"
        return
    if "type" not in schema:  # whatever it is, it is preserved
        yield from _of_any_type(schema, value, path)
        return
    kind = schema["type"]
    if type(value) not in _TYPES[kind]:  # a boolean is an integer to isinstance
        yield f"{path}: must be of type {kind}"
    elif "enum" in schema and value not in schema["enum"]:
        yield f"{path}: Unsupported value: {value!r}"
    else:
        yield from _CHECKS.get(kind, _nothing)(schema, value, path)


def _of_any_type(schema: Schema, value: Any, path: str) -> Iterator[str]:
    """A field without a type is judged by those of its bounds that its value's type has."""
    if value in schema.get("not", {}).get("enum", []) and isinstance(value, bool):
        yield f"{path}: must not validate the schema (not)"
    elif isinstance(value, int | float) and not isinstance(value, bool):
        yield from _bounds(schema, value, path)
        if value % schema.get("multipleOf", value or 1):
            yield f"{path}: should be a multiple of {schema['multipleOf']}"
    elif isinstance(value, str) and not re2.search(schema.get("pattern", ""), value):
        yield f"{path}: should match '{schema['pattern']}'"
    elif isinstance(value, list) and len(value) > schema.get("maxItems", len(value)):
        yield f"{path}: must have at most {schema['maxItems']} items"
    elif isinstance(value, dict):
        for name in [each for each in schema.get("required", []) if each not in value]:
            yield f"{path}.{name}: Required value"
        if len(value) > schema.get("maxProperties", len(value)):
            yield f"{path}: must have at most {schema['maxProperties']} items"


def _nothing(_schema: Schema, _value: Any, _path: str) -> Iterator[str]:
    return iter(())


def _text(schema: Schema, value: str, path: str) -> Iterator[str]:
    if len(value) > schema.get("maxLength", len(value)):
        yield f"{path}: Too long"


def _list(schema: Schema, value: list[Any], path: str) -> Iterator[str]:
    if not schema.get("minItems", 0) <= len(value) <= schema.get("maxItems", len(value)):
        yield f"{path}: a wrong number of items"
    for number, item in enumerate(value):
        yield from _structural(schema["items"], item, f"{path}[{number}]")
    yield from _repeated(schema, value, path)


def _object(schema: Schema, value: dict[str, Any], path: str) -> Iterator[str]:
    if "properties" in schema:
        yield from _fields(schema, value, path)
    elif isinstance(schema.get("additionalProperties"), dict):
        for name, item in value.items():
            yield from _structural(schema["additionalProperties"], item, f"{path}.{name}")


def _repeated(schema: Schema, value: list[Any], path: str) -> Iterator[str]:
    if schema.get("x-kubernetes-list-type", "atomic") == "atomic":
        return
    keys = schema.get("x-kubernetes-list-map-keys", [])
    known: list[Any] = []
    for number, item in enumerate(value):
        key = [item.get(name) for name in keys] if keys and isinstance(item, dict) else item
        if key in known:
            yield f"{path}[{number}]: Duplicate value"
        known.append(key)


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


_CHECKS: dict[str, Callable[[Schema, Any, str], Iterator[str]]] = {
    "integer": _bounds,
    "number": _bounds,
    "string": _text,
    "array": _list,
    "object": _object,
}


def _by_rules(schema: Schema, value: Any, path: str) -> Iterator[str]:
    for rule in schema.get("x-kubernetes-validations") or []:
        if "oldSelf" not in rule["rule"] and not _holds(rule["rule"], value):
            yield f"{path}: {rule['message']}"
    if schema.get("type") == "array":
        for number, item in enumerate(value):
            yield from _by_rules(schema["items"], item, f"{path}[{number}]")
    if schema.get("type") == "object":
        others = schema.get("additionalProperties")
        for name, item in value.items():
            below = schema.get("properties", {}).get(name, others)
            if isinstance(below, dict):
                yield from _by_rules(below, item, f"{path}.{name}")


def _holds(rule: str, value: Any) -> bool:
    context = cel.Context(variables={"self": value}, functions=_FUNCTIONS)
    # The reader's own regular expressions are not Go's, and its own functions can't be replaced.
    answer = cel.compile(rule.replace(".matches(", ".found(")).execute(context)
    if not isinstance(answer, bool):
        raise TypeError(f"{rule} gives {answer!r}")
    return answer


# k8s.io/apimachinery/pkg/api/resource: a number with a factor of 10 or of 2, or an exponent.
_QUANTITY = re.compile(r"([+-]?(?:\d+\.?\d*|\.\d+))(?:([KMGTPE]i)|([numkMGTPE])|[eE]([+-]?\d+))?")


def _quantity(text: str) -> float:
    found = _QUANTITY.fullmatch(text)
    if found is None:
        raise ValueError(f"{text!r} is no quantity")
    number, binary, decimal, exponent = found.groups()
    if binary:
        return float(number) * 1024.0 ** (1 + "KMGTPE".index(binary[0]))
    thousands = 1000.0 ** ("num kMGTPE".index(decimal) - 3) if decimal else 1.0
    return float(number) * thousands * 10.0 ** int(exponent or 0)


def _is_quantity(text: str) -> bool:
    return _QUANTITY.fullmatch(text) is not None


# k8s.io/apiserver/pkg/cel/library: what Kubernetes adds to CEL, as far as our rules use it.
_FUNCTIONS: dict[str, Any] = {
    "quantity": _quantity,
    "isQuantity": _is_quantity,
    "compareTo": lambda one, other: (one > other) - (one < other),
    "isGreaterThan": lambda one, other: one > other,
    "found": lambda text, pattern: re2.search(pattern, text) is not None,
    "split": lambda text, at: text.split(at),
    "substring": lambda text, begin, end: text[begin:end],
}
