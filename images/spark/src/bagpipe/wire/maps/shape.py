"""What the maps of the pipe are made of, and how a map that came is compared with its model."""

from collections.abc import Iterable
from typing import Annotated, Any

from pydantic import ConfigDict, Field, TypeAdapter, ValidationError, with_config

Schema = dict[str, Any]

# A receiver ignores keys that it does not know: those of a later version.
open_map = with_config(ConfigDict(extra="allow", strict=True))

_MOST_SHOWN = 60

Natural = Annotated[int, Field(ge=0, lt=2**64)]
Checksum = Annotated[int, Field(ge=0, lt=2**32)]
Signed = Annotated[int, Field(ge=-(2**31), lt=2**31)]
Number = Annotated[float, Field(allow_inf_nan=False)]
# Seconds that something took.
Elapsed = Annotated[float, Field(ge=0, allow_inf_nan=False)]


class MapError(Exception):
    """A map that is not as its model says; the sentence names the field."""


def default(value: object, description: str) -> Any:
    """A field that may be left out, and what is meant then."""
    return Field(description=description, json_schema_extra={"default": value})  # type: ignore[dict-item]


def check(name: str, model: TypeAdapter[Any], fields: dict[str, Any]) -> None:
    """Compares a map, which stays as it is, with its model. Raises MapError."""
    try:
        model.validate_python(fields)
    except ValidationError as error:
        first = error.errors(include_url=False, include_context=False)[0]
        place = _place(first["loc"])
        if first["type"] == "missing":
            wrong = f"has no {place}"
        else:
            found = repr(first["input"])
            cut = found if len(found) <= _MOST_SHOWN else f"{found[:_MOST_SHOWN]}..."
            wrong = f"has {cut} as {place} ({first['msg']})"
        raise MapError(
            f"{name} from the agent {wrong}: use one release's images together"
        ) from error


def _place(path: Iterable[int | str]) -> str:
    """A field as users write it: topics[0].sent."""
    parts = (f"[{part}]" if isinstance(part, int) else f".{part}" for part in path)
    return "".join(parts).lstrip(".")
