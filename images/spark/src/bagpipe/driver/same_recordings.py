"""The recordings that a job's first driver found: another driver of the job goes by the same.

Patterns are looked up again by each driver. What is gone by then would take its failed cases along,
and what has come would give others their names. So they are put beside the results once, each with
the name of its first fragment, as the catalogue is.
"""

import gzip
import io
import json
import posixpath
import re
from collections.abc import Callable, Iterable, Iterator
from dataclasses import replace

from bagpipe.plan.case import Case
from bagpipe.plan.made import Plan, Unplanned, mark_of
from bagpipe.run.case_run import Row
from bagpipe.storage import Storage, StorageError

FILE = "recordings.json.gz"
_SCHEMA = "sim.bagpipe.io/recordings/v1alpha1"
_MOST_BYTES = 256 << 20
_MOST_COMPRESSED_BYTES = 64 << 20
# What a fragment's name has behind that of its recording.
_NUMBER = re.compile(r"-[0-9]{4,}$")

# The name of a recording's first fragment, by its URI; empty where it has none of its own.
Recordings = dict[str, str]


def of_the_same_recordings(
    storage: Storage, folder: str, planned: Plan, journaled: Callable[[], Iterable[Row]]
) -> Plan:
    """The plan of the recordings that the job began with, by the names that cases had then.

    One that is gone yields no case. A job that an earlier release has begun began with those that
    are there and those that `journaled` gives. Raises StorageError.
    """
    now = recordings_of(planned)
    first = _first(storage, posixpath.join(folder, FILE), now, journaled)
    if first == now:
        return planned
    cases, of_others = list[Case](), list[Case]()
    for case in planned.cases:
        there = [uri in first for uri in _recordings(case)]
        if any(there):
            (cases if all(there) else of_others).append(case)
    unplanned = [each for each in planned.unplanned if each.bag in first]
    lost = sorted(first.keys() - now.keys())
    if lost:
        # A folder that could not be listed has lost them, and says why.
        unplanned = list(planned.unplanned)
    unplanned += _gone(lost, storage, bool(unplanned))
    unplanned += map(_of_others, of_others)
    return replace(planned, cases=list(_renamed(cases, first, now)), unplanned=unplanned)


def recordings_of(planned: Plan) -> Recordings:
    """All that a plan is about: URIs, and words where the source has no single recording."""
    found = {each.bag: "" for each in planned.unplanned}
    for case in sorted(planned.cases, key=lambda case: case.id):
        for uri in _recordings(case):
            found[uri] = found.get(uri) or ("" if case.parts else case.fragment or case.id)
    return found


def _recordings(case: Case) -> list[str]:
    return [part.bag for part in case.parts] or [case.bag]


def _first(
    storage: Storage, uri: str, now: Recordings, journaled: Callable[[], Iterable[Row]]
) -> Recordings:
    if not storage.exists(uri):
        began = now | _of_rows(journaled())
        document = {"schema": _SCHEMA, "recordings": began}
        text = json.dumps(document, sort_keys=True).encode()
        if storage.put_once(uri, gzip.compress(text, mtime=0)):
            return began
    packed = storage.read_all(uri, _MOST_COMPRESSED_BYTES)
    try:
        with gzip.open(io.BytesIO(packed)) as file:
            found = json.loads(file.read(_MOST_BYTES))["recordings"]
        return {str(each): str(name) for each, name in found.items()}
    except (OSError, EOFError, ValueError, TypeError, KeyError, AttributeError) as error:
        raise StorageError(
            f"{uri} does not say with which recordings the job began ({error!r}): create the job"
            " again"
        ) from error


def _of_rows(rows: Iterable[Row]) -> Recordings:
    found: Recordings = {}
    for row in rows:
        parts = [str(part["bag"]) for part in row.get("parts") or []]
        name = str(row.get("fragment") or row["case"])
        for uri in parts or [str(row.get("bag") or "")]:
            found[uri] = "" if parts else min(name, found.get(uri) or name)
    return found


def _renamed(cases: Iterable[Case], first: Recordings, now: Recordings) -> Iterator[Case]:
    """The cases by the names that they had first: of recordings of one name these depend on which
    there are, and results, quarantines and comparisons go by them."""
    named: dict[str, tuple[str, str]] = {}
    for uri in first.keys() & now.keys():
        if first[uri] and now[uri] and first[uri] != now[uri]:
            named[uri] = _stems(first[uri], now[uri])
    for case in cases:
        then, by_now = named.get(case.bag, ("", "")) if not case.parts else ("", "")
        if then == by_now or not case.id.startswith(by_now):
            yield case
        else:
            fragment = then + case.fragment.removeprefix(by_now) if case.fragment else ""
            yield replace(case, id=then + case.id.removeprefix(by_now), fragment=fragment)


def _stems(first: str, now: str) -> tuple[str, str]:
    if _NUMBER.search(first) and _NUMBER.search(now):
        return _NUMBER.sub("", first), _NUMBER.sub("", now)
    return first, now


def _gone(uris: list[str], storage: Storage, has_reason: bool) -> Iterator[Unplanned]:
    """Those of which nothing is planned any more.

    One that is there still is a piece of a case that something else keeps from being made; where
    that has no reason yet, this is it.
    """
    for uri in uris:
        try:
            there = "://" in uri and storage.exists(uri)
            what = "is planned no more" if there else "is not there any more"
        except StorageError as error:
            there, what = False, f"can't be looked for ({error})"
        if there and has_reason:
            continue
        name = posixpath.splitext(posixpath.basename(uri))[0] or "recording"
        yield Unplanned(
            f"{name}-{mark_of(uri)}",
            uri,
            "BagMissing",
            f"{uri}, with which the job began, {what}: its cases count as errored, whatever they"
            " came to before; bring it back and create the job again",
        )


def _of_others(case: Case) -> Unplanned:
    return Unplanned(
        case.id,
        case.bag,
        "BagMissing",
        f"{case.id} is put together of other recordings by now than when the job began: create the"
        " job again",
    )
