"""What a job's first driver planned, put beside the results once, as far as others go by it.

These are the recordings with the names that they had and, where somebody chose some of the cases,
which. An earlier release's file has neither the choice nor the names of what yielded no case.
"""

import dataclasses
import gzip
import io
import json
import posixpath
from collections import Counter
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Self

from bagpipe.plan.case import Case
from bagpipe.plan.made import Plan
from bagpipe.run.case_run import Row
from bagpipe.storage import Storage, StorageUnfitError

FILE = "recordings.json.gz"
_SCHEMA = "sim.bagpipe.io/recordings/v1alpha1"
_MOST_BYTES = 256 << 20
_MOST_COMPRESSED_BYTES = 64 << 20

# Names by the URIs of recordings.
Names = dict[str, str]


@dataclass(frozen=True)
class FirstPlan:
    """`recordings` has the name of each one's first fragment; empty where it has none of its own.

    `unplanned` has the name of each of these that is in no case; empty where it has several.
    `chosen` has, by the names of the cases that were chosen, a recording of each; None: all were.
    """

    recordings: Names
    unplanned: Names
    chosen: dict[str, str] | None = None

    @classmethod
    def of(cls, planned: Plan, wanted: Plan) -> Self:
        """Of a plan, and of what is wanted of it: the plan itself, where nobody chose."""
        names, unplanned = names_of(planned), _unplanned_names(planned)
        if wanted is planned:
            return cls(names, unplanned)
        kept = names_of(wanted).keys()
        return cls(
            {uri: name for uri, name in names.items() if uri in kept},
            {uri: name for uri, name in unplanned.items() if uri in kept},
            {case.id: recordings_of(case)[0] for case in wanted.cases},
        )

    def has(self, case: Case) -> bool:
        """Whether a case of that name was wanted."""
        return self.chosen is None or case.id in self.chosen

    def and_of(self, rows: Iterable[Row]) -> Self:
        """And of the rows of a job that a release began which kept nothing of all this."""
        names, ran = Names(), dict[str, str]()
        for row in rows:
            bag = str(row.get("bag") or "")
            uris = _whose(bag, [str(part["bag"]) for part in row.get("parts") or []])
            # That of a bag without a case is no fragment's.
            name = str(row.get("fragment") or row["case"]) if "window" in row else ""
            for uri in uris:
                # A piece's own cases have other names than what it is a piece of.
                names[uri] = names.get(uri) or (name if uri == bag else "")
            if name:
                ran[row["case"]] = uris[0]
        found = {uri: name or self.recordings.get(uri, "") for uri, name in names.items()}
        chosen = None if self.chosen is None else self.chosen | ran
        return dataclasses.replace(self, recordings=self.recordings | found, chosen=chosen)


def has_begun(storage: Storage, folder: str) -> bool:
    """Whether a driver of the job has planned before. Raises StorageError."""
    return storage.exists(posixpath.join(folder, FILE))


def first_plan(
    storage: Storage,
    folder: str,
    planned: Plan,
    wanted: Callable[[Plan], Plan],
    journaled: Callable[[], Iterable[Row]],
) -> FirstPlan:
    """What the first driver of the job planned, which may be this one.

    Raises NoCaseError where this one is, and nothing is wanted; StorageError.
    """
    uri = posixpath.join(folder, FILE)
    if not has_begun(storage, folder):
        mine = FirstPlan.of(planned, wanted(planned)).and_of(journaled())
        document = {"schema": _SCHEMA} | dataclasses.asdict(mine)
        text = json.dumps(document, sort_keys=True).encode()
        if storage.put_once(uri, gzip.compress(text, mtime=0)):
            return mine
    return _read(storage.read_all(uri, _MOST_COMPRESSED_BYTES), uri)


def names_of(planned: Plan) -> Names:
    """All that a plan is about: URIs, and words where the source has no single recording."""
    found = {each.bag: "" for each in planned.unplanned}
    for case in sorted(planned.cases, key=lambda case: case.id):
        for uri in recordings_of(case):
            name = case.fragment or case.id if uri == case.bag else ""
            found[uri] = found.get(uri) or name
    return found


def recordings_of(case: Case) -> list[str]:
    """Its recording, which may be a folder of many files; else those that it is put together of."""
    return _whose(case.bag, [part.bag for part in case.parts])


def _unplanned_names(planned: Plan) -> Names:
    in_cases = {uri for case in planned.cases for uri in recordings_of(case)}
    counts = Counter(each.bag for each in planned.unplanned)
    return {
        each.bag: each.id if counts[each.bag] == 1 else ""
        for each in planned.unplanned
        if each.bag not in in_cases
    }


def _whose(bag: str, parts: list[str]) -> list[str]:
    return [bag] if "://" in bag or not parts else parts


def _read(packed: bytes, uri: str) -> FirstPlan:
    try:
        with gzip.open(io.BytesIO(packed)) as file:
            found = json.loads(file.read(_MOST_BYTES))
        chosen = found.get("chosen")
        return FirstPlan(
            _texts(found["recordings"]),
            _texts(found.get("unplanned") or {}),
            None if chosen is None else _texts(chosen),
        )
    except (OSError, EOFError, ValueError, TypeError, KeyError, AttributeError) as error:
        raise StorageUnfitError(
            f"{uri} does not say with which recordings the job began ({error!r}): create the job"
            " again"
        ) from error


def _texts(found: dict[str, str]) -> dict[str, str]:
    return {str(each): str(of) for each, of in found.items()}
