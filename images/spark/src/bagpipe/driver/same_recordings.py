"""The recordings that a job's first driver found: another driver of the job goes by the same.

Patterns are looked up again by each driver. What is gone by then would take its failed cases along,
and what has come would give others their names. So they are put beside the results once, as the
catalogue is.
"""

import gzip
import io
import json
import posixpath
from collections.abc import Callable, Iterable
from dataclasses import replace

from bagpipe.plan.case import Case
from bagpipe.plan.made import Plan, Unplanned, mark_of
from bagpipe.run.case_run import Row
from bagpipe.storage import Storage, StorageError

FILE = "recordings.json.gz"
_SCHEMA = "sim.bagpipe.io/recordings/v1alpha1"
_MOST_BYTES = 256 << 20
_MOST_COMPRESSED_BYTES = 64 << 20


def of_the_same_recordings(
    storage: Storage, folder: str, planned: Plan, journaled: Callable[[], Iterable[Row]]
) -> Plan:
    """The plan of the recordings that the job began with; one that is gone yields no case.

    A job that an earlier release has begun began with those that are there and those that
    `journaled` gives. Raises StorageError.
    """
    now = recordings_of(planned)
    first = _first(storage, posixpath.join(folder, FILE), now, journaled)
    if first == now:
        return planned
    cases = [case for case in planned.cases if set(_recordings(case)) <= first]
    unplanned = [each for each in planned.unplanned if each.bag in first]
    unplanned += [_gone(uri) for uri in sorted(first - now)]
    return replace(planned, cases=cases, unplanned=unplanned)


def recordings_of(planned: Plan) -> set[str]:
    """All that a plan is about: URIs, and words where the source has no single recording."""
    found = {uri for case in planned.cases for uri in _recordings(case)}
    return found | {each.bag for each in planned.unplanned}


def _recordings(case: Case) -> list[str]:
    return [part.bag for part in case.parts] or [case.bag]


def _first(
    storage: Storage, uri: str, now: set[str], journaled: Callable[[], Iterable[Row]]
) -> set[str]:
    if not storage.exists(uri):
        then = {uri for row in journaled() for uri in _recordings_of_row(row)}
        document = {"schema": _SCHEMA, "recordings": sorted(now | then)}
        if storage.put_once(uri, gzip.compress(json.dumps(document).encode(), mtime=0)):
            return now | then
    packed = storage.read_all(uri, _MOST_COMPRESSED_BYTES)
    try:
        with gzip.open(io.BytesIO(packed)) as file:
            found = json.loads(file.read(_MOST_BYTES))["recordings"]
        return {str(each) for each in found}
    except (OSError, EOFError, ValueError, TypeError, KeyError) as error:
        raise StorageError(
            f"{uri} does not say with which recordings the job began ({error!r}): create the job"
            " again"
        ) from error


def _recordings_of_row(row: Row) -> list[str]:
    parts = row.get("parts") or []
    return [str(part["bag"]) for part in parts] or [str(row.get("bag") or "")]


def _gone(uri: str) -> Unplanned:
    name = posixpath.splitext(posixpath.basename(uri))[0] or "recording"
    return Unplanned(
        f"{name}-{mark_of(uri)}",
        uri,
        "BagMissing",
        f"{uri} was there when the job began, and another driver of it finds it no more: its cases"
        " count as errored, whatever they came to before; bring it back and create the job again",
    )
