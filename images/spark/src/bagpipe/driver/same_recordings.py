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
from collections import Counter
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
# What a fragment's name has behind that of its recording.
_NUMBER = re.compile(r"-[0-9]{4,}$")

# The name of a recording's first fragment, by its URI; empty where it has none of its own.
Recordings = dict[str, str]


def of_the_same_recordings(
    storage: Storage, folder: str, planned: Plan, journaled: Callable[[], Iterable[Row]]
) -> tuple[Plan, list[Unplanned]]:
    """The plan of the recordings that the job began with, by the names that cases had then; and
    what of them yields no case any more, with the reasons that there are for it.

    A job that an earlier release has begun began with those that are there and those that
    `journaled` gives. Raises StorageError.
    """
    now = recordings_of(planned)
    first = _first(storage, posixpath.join(folder, FILE), now, journaled)
    if first == now:
        return planned, []
    cases, lost = list[Case](), list[Unplanned]()
    for case in planned.cases:
        there = [uri in first for uri in _recordings(case)]
        if all(there):
            cases.append(case)
        elif any(there):
            lost.append(_of_others(case))
    gone = [_gone(uri) for uri in sorted(first.keys() - now.keys())]
    unplanned = [each for each in planned.unplanned if each.bag in first]
    if gone:
        # A folder that could not be listed has lost them, and says why.
        gone += [each for each in planned.unplanned if each.bag not in first]
    made = replace(planned, cases=_renamed(cases, first, now), unplanned=unplanned)
    return made, [*gone, *lost]


def recordings_of(planned: Plan) -> Recordings:
    """All that a plan is about: URIs, and words where the source has no single recording."""
    found = {each.bag: "" for each in planned.unplanned}
    for case in sorted(planned.cases, key=lambda case: case.id):
        for uri in _recordings(case):
            found[uri] = found.get(uri) or (_name(case) if uri == case.bag else "")
    return found


def _recordings(case: Case) -> list[str]:
    """Its recording, which may be a folder of many files; else those that it is put together of."""
    return _whose(case.bag, [part.bag for part in case.parts])


def _whose(bag: str, parts: list[str]) -> list[str]:
    return [bag] if "://" in bag or not parts else parts


def _name(case: Case) -> str:
    return case.fragment or case.id


def _first(
    storage: Storage, uri: str, now: Recordings, journaled: Callable[[], Iterable[Row]]
) -> Recordings:
    if not storage.exists(uri):
        began = now | {
            each: name or now.get(each, "") for each, name in _of_rows(journaled()).items()
        }
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
        bag, parts = (
            str(row.get("bag") or ""),
            [str(part["bag"]) for part in row.get("parts") or []],
        )
        # That of a bag without a case is no fragment's.
        name = str(row.get("fragment") or row["case"]) if "window" in row else ""
        for uri in _whose(bag, parts):
            known = found.get(uri, "")
            found[uri] = (min(name, known) if name and known else name or known) * (uri == bag)
    return found


def _renamed(cases: list[Case], first: Recordings, now: Recordings) -> list[Case]:
    """The cases by the names that they had first: of recordings of one name these depend on which
    there are, and results, quarantines and comparisons go by them.

    Raises StorageError where two would have one name.
    """
    stems = {
        uri: _stems(first[uri], now[uri])
        for uri in first.keys() & now.keys()
        if first[uri] and now[uri] and first[uri] != now[uri]
    }
    named = [_of_stem(case, *stems.get(case.bag, ("", ""))) for case in cases]
    counts = Counter(case.id for case in named)
    if stems and (twice := [name for name, count in counts.items() if count > 1]):
        raise StorageError(
            f"two cases would have the name {min(twice)} that one had when the job began: create"
            " the job again"
        )
    return named


def _of_stem(case: Case, then: str, now: str) -> Case:
    if then == now or not case.id.startswith(now):
        return case
    fragment = then + case.fragment.removeprefix(now) if case.fragment else ""
    return replace(case, id=then + case.id.removeprefix(now), fragment=fragment)


def _stems(first: str, now: str) -> tuple[str, str]:
    if _NUMBER.search(first) and _NUMBER.search(now):
        return _NUMBER.sub("", first), _NUMBER.sub("", now)
    return first, now


def _gone(uri: str) -> Unplanned:
    name = posixpath.splitext(posixpath.basename(uri))[0] or "recording"
    return Unplanned(
        f"{name}-{mark_of(uri)}",
        uri,
        "BagMissing",
        f"{uri}, with which the job began, is in no case of what another driver of it found: its"
        " cases count as errored, whatever they came to before; bring it back and create the job"
        " again",
    )


def _of_others(case: Case) -> Unplanned:
    return Unplanned(
        case.id,
        case.bag,
        "BagMissing",
        f"{case.id} is put together of other recordings by now than when the job began: create the"
        " job again",
    )
