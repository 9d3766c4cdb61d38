"""Answers with objects of a megabyte, read one object at a time, each without what nobody keeps.

Python takes ten bytes for one of JSON: a page of the largest objects that a tenant may store,
parsed whole, is more than the operator's memory limit (issue 13).
"""

import json
from typing import Any

from bagpipe.marks import PREFIX
from bagpipe_operator import readings
from bagpipe_operator.kept_spec import scalars
from bagpipe_operator.nesting import cut, loads

Json = dict[str, Any]

# The text of a larger object is trimmed; jobs with a robot's description are 20 KB.
LARGE_TEXT = 64 << 10
# Objects in one page: twenty of the largest are 30 MB of text.
PAGE = 20
# In the place of what was left out. No stored object has it: the CRDs' schemas prune it.
TRIMMED = "bagpipeTrimmed"

_ITEMS = '"items":['
_OF_METADATA = frozenset(
    {
        "name", "namespace", "uid", "generation", "resourceVersion", "creationTimestamp",
        "deletionTimestamp", "continue",
    }
)  # fmt: skip
_DECODER = json.JSONDecoder()


def read_object(data: bytes) -> Any:
    """The value of an answer to a write, trimmed if it is large; raises ValueError for no JSON."""
    value = loads(data.decode("utf-8", "replace"))
    return trimmed(value) if len(data) > LARGE_TEXT and isinstance(value, dict) else value


def read_answer(data: bytes) -> Any:
    """The value of an answer, large objects of a list trimmed; raises ValueError for no JSON."""
    text = data.decode("utf-8", "replace")
    begin = text.find(_ITEMS)
    if begin < 0 or len(data) <= LARGE_TEXT or not _is_list(text[:begin]):
        return loads(text)
    try:
        return _read_list(text, begin + len(_ITEMS))
    except RecursionError:
        return _read_list(shallow := cut(data).decode(), shallow.find(_ITEMS) + len(_ITEMS))


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
        item, end = _DECODER.raw_decode(text, at)
        items.append(trimmed(item) if end - at > LARGE_TEXT else item)
        at = end + 1 if text[end : end + 1] == "," else end
    value = json.loads(head + text[at:])
    value["items"] = items
    return value


def read_event(line: bytes) -> bytes:
    """A line of a watch, its object trimmed; the line itself if it is no event.

    A megabyte of brackets takes Python's parser 0.05 s, and `cut` a second: only where it must.
    """
    try:
        event = loads(line)
    except ValueError:
        return line
    if not isinstance(event, dict) or not isinstance(event.get("object"), dict):
        return cut(line)
    return json.dumps(event | {"object": trimmed(event["object"])}).encode()


def trimmed(thing: Json) -> Json:
    """A job, schedule or pod with what its view keeps of it; marked, where a spec is missing."""
    meta, spec = readings.mapping(thing.get("metadata")), readings.mapping(thing.get("spec"))
    kept: Json = {key: thing[key] for key in ("apiVersion", "kind", "status") if key in thing}
    kept["metadata"] = {key: value for key, value in meta.items() if key in _OF_METADATA}
    owners = meta.get("ownerReferences") or []
    kept["metadata"]["ownerReferences"] = [each for each in owners if each.get("controller")]
    kept["metadata"]["labels"] = _ours(meta.get("labels"))
    if "containers" in spec:
        volumes = [v for v in spec.get("volumes") or [] if "persistentVolumeClaim" in v]
        return kept | {"spec": {"nodeName": spec.get("nodeName"), "volumes": volumes}}
    executors = readings.whole(readings.mapping(spec.get("spark")).get("executors"))
    spark = {} if executors is None else {"spark": {"executors": executors}}
    return kept | {"spec": scalars(spec) | spark, TRIMMED: True}


def _ours(labels: object) -> Json:
    return {k: v for k, v in readings.mapping(labels).items() if k.startswith(PREFIX)}
