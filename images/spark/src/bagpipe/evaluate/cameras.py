"""What cameras showed when a case failed: small pictures that travel with its row.

They are made in the executor, where the recording is open already; whoever makes the page decodes
no message. A topic is a camera's by its type, so nobody has asked for it: of a definition only what
such a type has is taken, and whatever fails is a sentence.
"""

import base64
import logging
from collections.abc import Callable, Mapping
from typing import Any

from rosbags.interfaces import Nodetype

from bagpipe.definitions import HEADER, OLD_HEADER, full_name, types_in
from bagpipe.evaluate.decoding import decoder
from bagpipe.evaluate.evidence import Received, Recording
from bagpipe.evaluate.finding import NoEvidenceError
from bagpipe.moments import moments
from bagpipe.pictures import MOST_OF_A_CASE, PictureError, Thumbnail

_IMAGE = "sensor_msgs/msg/Image"
_SHOWN = (_IMAGE, "sensor_msgs/msg/CompressedImage")
# A type may hold those of a lower rank.
_RANKS = dict.fromkeys(_SHOWN, 2) | {HEADER: 1, OLD_HEADER: 1, "builtin_interfaces/msg/Time": 0}
_MOST_FIELDS, _MOST_DEFINITION = 16, 1 << 16
_MOST_MESSAGE = 64 << 20
# A moment has four digits of a second.
_ROUNDED = 50_000
_CHARACTERS = 200

log = logging.getLogger(__name__)


def is_camera(kind: str) -> bool:
    """Whether messages of this type may be shown."""
    return full_name(kind) in _SHOWN


def first_moment(findings: list[dict[str, Any]], start: int) -> int | None:
    """When a criterion first left its bounds, in ns; None where none did, or none knows when."""
    found = moments({"criteria": findings})
    return start + round(found[0].seconds * 1e9) + _ROUNDED if found else None


def seen(
    recorded: Mapping[str, Callable[[], Recording]],
    played: Mapping[str, Callable[[], Recording]],
    start: int,
    at: int,
) -> list[dict[str, Any]]:
    """The last image until a time of cameras' topics, each in its recording; never raises.

    `topic`, `of` (`output` or `input`), and `at` (seconds after `start`), `width`, `height`, `type`
    and `data` in base64, or `fault`, a sentence. One of each, or two where there is none of either.
    """
    outputs = [("output", topic, recorded[topic]) for topic in sorted(recorded)]
    inputs = [("input", topic, played[topic]) for topic in sorted(played)]
    half = MOST_OF_A_CASE // 2
    chosen = outputs[: MOST_OF_A_CASE - min(half, len(inputs))]
    chosen += inputs[: MOST_OF_A_CASE - len(chosen)]
    return [
        {"topic": topic[:_CHARACTERS], "of": of} | _shown(topic, opened, start, at)
        for of, topic, opened in chosen
    ]


def _shown(topic: str, opened: Callable[[], Recording], start: int, at: int) -> dict[str, Any]:
    try:
        last = _last(opened().received(topic), at)
        thumbnail = _thumbnail(last)
    except (PictureError, NoEvidenceError) as why:
        return {"fault": str(why)[:_CHARACTERS]}
    except Exception as fault:  # whatever a camera sent, the case is what it is
        log.info("no picture of %s", topic, exc_info=True)
        return {"fault": f"it can't be read: {type(fault).__name__}"}
    return {
        "at": round((last.time - start) / 1e9, 4),
        "width": thumbnail.width,
        "height": thumbnail.height,
        "type": thumbnail.kind,
        "data": base64.b64encode(thumbnail.data).decode(),
    }


def _last(messages: list[Received], at: int) -> Received:
    before = [each for each in messages if each.time <= at]
    if not before:
        raise PictureError("there is no image until the failing moment")
    return max(before, key=lambda each: each.time)


def _thumbnail(received: Received) -> Thumbnail:
    kind = full_name(received.connection.type)
    if kind not in _SHOWN or not _as_known(received.connection, kind):
        raise PictureError("its definition is not that of a camera's images")
    if len(received.raw) > _MOST_MESSAGE:
        raise PictureError(f"its message has {len(received.raw):,} bytes")
    # It imports NumPy, 0.1 s which every command would take and a driver, who show no image.
    from bagpipe.evaluate import thumbnails  # noqa: PLC0415

    made = thumbnails.of_image if kind == _IMAGE else thumbnails.of_compressed
    return made(decoder(received.connection)(received.raw))


def _as_known(connection: Any, kind: str) -> bool:
    """Whether the definition has no more than an image needs: reading a message of it takes no more
    memory than the message.
    """
    if len(connection.definition) > _MOST_DEFINITION:
        return False
    types = types_in(connection.type, connection.definition, connection.schema_encoding)
    return kind in types and all(
        len(types[name][1]) <= _MOST_FIELDS
        and all(_is_plain(field, _RANKS[name]) for _, field in types[name][1])
        for name in _RANKS.keys() & types.keys()
    )


def _is_plain(field: Any, rank: int) -> bool:
    kind, detail = field
    if kind == Nodetype.SEQUENCE:
        return bool(detail[0] == (Nodetype.BASE, ("uint8", 0)))
    return kind == Nodetype.BASE or (kind == Nodetype.NAME and _RANKS.get(detail, rank) < rank)
