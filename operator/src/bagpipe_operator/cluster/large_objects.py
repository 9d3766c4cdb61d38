"""Answers with large objects, read one object at a time, each without what nobody keeps.

Python takes ten to twenty bytes for one of JSON: a page of the largest objects that a tenant may
store, parsed whole, is more than the operator's memory limit (issue 13).
"""

import asyncio
import gc
import json
from collections.abc import Callable
from typing import Any, TypeVar

from bagpipe_operator.api import names, readings
from bagpipe_operator.api.kept_spec import LARGEST_KEPT_BYTES, what_decides
from bagpipe_operator.api.nesting import cut, end_of, loads

Json = dict[str, Any]
_Read = TypeVar("_Read")

# The text of a larger object is trimmed: its spec may be one that is not kept.
TRIMMED_FROM = 2 * LARGEST_KEPT_BYTES
# Each call about a larger one is much work for the API server; jobs with a robot's description are
# 30 KB.
LARGE = 64 << 10
# Longer texts are read in a thread, so that the Lease is renewed meanwhile.
_ASIDE = 256 << 10
# Objects in one page: twenty of the largest are 30 MB of text.
PAGE = 20
# How many bytes the text had, and that something was left out. The CRDs' schemas prune such fields,
# so no stored object has them.
SIZE, TRIMMED = "bagpipeSize", "bagpipeTrimmed"

_ITEMS = '"items":['
_OF_METADATA = frozenset(
    {
        "name", "namespace", "uid", "generation", "resourceVersion", "creationTimestamp",
        "deletionTimestamp", "continue",
    }
)  # fmt: skip
_LABELS = frozenset(
    {
        names.LABEL_JOB, names.LABEL_JOB_UID, names.LABEL_ROLE, names.LABEL_ATTEMPT,
        names.LABEL_SCHEDULE,
    }
)  # fmt: skip
# What is read of an Event, and how much of its texts: as much as the API server takes of an Event
# of the newer kind. Of the older kind it takes megabytes.
_OF_EVENT = ("lastTimestamp", "eventTime", "series")
_LONGEST_MESSAGE, _LONGEST_WORD, _LONGEST_PATH = 1024, 128, 256
_DECODER = json.JSONDecoder()


def is_large(thing: Json) -> bool:
    """Whether an object's text, as it was read, is larger than LARGE."""
    return bool(thing.get(SIZE, 0) > LARGE)


async def read_answer(data: bytes, *, written: bool = False) -> Any:
    """The value of an answer; raises ValueError for no JSON.

    Objects of a list, and what was `written`, are trimmed if they are large.
    """
    read = read_written if written else read_whole
    return await _aside(read, data) if len(data) > _ASIDE else read(data)


async def read_event(line: bytes) -> bytes:
    """A line of a watch, its object trimmed if it is large; the line itself if it is no event."""
    return await _aside(_event, line) if len(line) > _ASIDE else _event(line)


async def _aside(read: Callable[[bytes], _Read], text: bytes) -> _Read:
    return await asyncio.to_thread(_uncollected, read, text)


def _uncollected(read: Callable[[bytes], _Read], text: bytes) -> _Read:
    """Reading makes no cycles, but up to half a million lists of one object, of which the collector
    would look for some fifty times.
    """
    if not gc.isenabled():  # another thread reads, and will switch it on
        return read(text)
    gc.disable()
    try:
        return read(text)
    finally:
        gc.enable()


def read_written(data: bytes) -> Any:
    """The value of an answer to a write, trimmed if it is large; raises ValueError for no JSON."""
    value = read_whole(data)
    return trimmed(value) if isinstance(value, dict) and SIZE in value else value


def read_whole(data: bytes) -> Any:
    """The value of an answer, large objects of a list trimmed; raises ValueError for no JSON."""
    text = data.decode("utf-8", "replace")
    begin = text.find(_ITEMS)
    if begin >= 0 and len(data) > TRIMMED_FROM and _is_list(text[:begin]):
        return _read_list(text, begin + len(_ITEMS))
    return _sized(loads(text), len(data))


def _is_list(head: str) -> bool:
    """Whether what comes next is a field of the answer itself, and of nothing inside of it."""
    try:
        json.loads(head + _ITEMS + "]}")
    except (ValueError, RecursionError):
        return False
    return True


def _read_list(text: str, at: int) -> Any:
    head, items = text[:at], []
    while text[at : at + 1] not in ("]", ""):
        item, end = _item(text, at)
        sized = _sized(item, end - at)
        items.append(trimmed(sized) if isinstance(sized, dict) and SIZE in sized else sized)
        at = end + 1 if text[end : end + 1] == "," else end
    value = json.loads(head + text[at:])
    value["items"] = items
    return value


def _item(text: str, at: int) -> tuple[Any, int]:
    try:
        return _DECODER.raw_decode(text, at)
    except RecursionError:
        end = end_of(text, at)
        return loads(text[at:end]), end


def _sized(value: Any, size: int) -> Any:
    """The object with the size of its text, where that matters."""
    return value | {SIZE: size} if size > TRIMMED_FROM and isinstance(value, dict) else value


def _event(line: bytes) -> bytes:
    """A megabyte of brackets takes Python's parser 0.05 s, and `cut` more: only where it must."""
    try:
        event = loads(line)
    except ValueError:
        return line
    # kopf looks into an ERROR for its code.
    if not isinstance(event, dict) or event.get("type") == "ERROR":
        return cut(line)
    if not isinstance(event.get("object"), dict):
        return cut(line)
    return json.dumps(event | {"object": trimmed(_sized(event["object"], len(line)))}).encode()


def trimmed(thing: Json) -> Json:
    """A job, schedule, pod or Event with what is read of it; marked, where a spec is missing.

    Whatever else keeps all but most of its metadata.
    """
    meta, spec = readings.mapping(thing.get("metadata")), readings.mapping(thing.get("spec"))
    kept: Json = {k: thing[k] for k in ("apiVersion", "kind", "status", SIZE) if k in thing}
    kept["metadata"] = {key: value for key, value in meta.items() if key in _OF_METADATA}
    labels = readings.mapping(meta.get("labels"))
    kept["metadata"]["labels"] = {key: labels[key] for key in _LABELS if key in labels}
    owners = [
        each for each in readings.objects(meta.get("ownerReferences")) if each.get("controller")
    ]
    kept["metadata"]["ownerReferences"] = owners
    if shape := shape_of(meta):
        kept["metadata"]["annotations"] = {names.ANNOTATION_SHAPE: shape}
    if "involvedObject" in thing:
        return kept | _of_event(thing)
    if "spec" not in thing:  # metadata alone
        return {key: value for key, value in thing.items() if key != "metadata"} | kept
    if "containers" in spec:
        volumes = [v for v in readings.objects(spec.get("volumes")) if "persistentVolumeClaim" in v]
        return kept | {"spec": {"nodeName": spec.get("nodeName"), "volumes": volumes}}
    return kept | {"spec": what_decides(spec), TRIMMED: True}


def shape_of(meta: Json) -> str:
    """Of a driver that waits for another job, by its metadata: without it, its pool would end it.

    Empty for any other pod, and for one whose annotation is too long to be ours.
    """
    shape = str(readings.mapping(meta.get("annotations")).get(names.ANNOTATION_SHAPE) or "")
    return shape if len(shape) <= _LONGEST_WORD else ""


def _of_event(event: Json) -> Json:
    kept = {key: event[key] for key in _OF_EVENT if key in event}
    path = readings.mapping(event["involvedObject"]).get("fieldPath")
    return kept | {
        "reason": str(event.get("reason") or "")[:_LONGEST_WORD],
        "message": str(event.get("message") or "")[:_LONGEST_MESSAGE],
        "involvedObject": {"fieldPath": str(path or "")[:_LONGEST_PATH]},
    }
