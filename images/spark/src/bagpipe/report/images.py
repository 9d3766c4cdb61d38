"""Images of the failing moment for the page: checked, since rows may be anybody's. Pure."""

import base64
import binascii
from collections.abc import Mapping
from typing import Any

from bagpipe.pictures import MOST_BYTES, MOST_OF_A_CASE, kind_of
from bagpipe.row_facts import is_finite

Row = Mapping[str, Any]

_CHARACTERS = 200


def images_of(row: Row) -> list[dict[str, Any]]:
    """`topic` and `of` of each, and `at`, `width`, `height`, `type` and `data`, or `fault`."""
    given = row.get("images")
    images = given[:MOST_OF_A_CASE] if isinstance(given, list) else []
    return [_checked(image) for image in images if isinstance(image, Mapping)]


def _checked(image: Mapping[str, Any]) -> dict[str, Any]:
    named = {
        "topic": str(image.get("topic") or "")[:_CHARACTERS],
        "of": "input" if image.get("of") == "input" else "output",
    }
    if "fault" in image:
        return named | {"fault": str(image["fault"])[:_CHARACTERS]}
    data, at = image.get("data"), image.get("at")
    found = kind_of(_bytes(data)) if isinstance(data, str) else None
    if found is None or not is_finite(at):
        return named | {"fault": "the line of results.jsonl has no picture that can be shown"}
    # The type is what the bytes are, whatever the row calls them.
    size = {name: _size(image.get(name)) for name in ("width", "height")}
    return named | size | {"at": at, "type": found.kind, "data": data}


def _bytes(text: str) -> bytes:
    """Nothing where it is too long, or no base64."""
    if len(text) > 4 * -(-MOST_BYTES // 3):
        return b""
    try:
        return base64.b64decode(text, validate=True)
    except (binascii.Error, ValueError):
        return b""


def _size(value: Any) -> int | None:
    return value if isinstance(value, int) and 0 < value < 1 << 32 else None
