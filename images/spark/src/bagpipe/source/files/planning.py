"""The cases of a job whose source is files of any kind: one case for each file, as it is."""

import posixpath
from collections import Counter

from bagpipe.plan.case import Case
from bagpipe.plan.fragments import Window
from bagpipe.plan.made import mark_of
from bagpipe.source.naming import plain
from bagpipe.storage import Stat, Storage

# A file has no bag time: the program that reads it knows what its bytes mean.
_NO_WINDOW = Window(0, 0, 0)


def file_cases(uris: list[str], storage: Storage) -> list[Case]:
    """One case per URI, whole. Raises StorageError."""
    return [
        _case(uri, name, storage.stat(uri)) for uri, name in zip(uris, _names(uris), strict=True)
    ]


def _case(uri: str, name: str, found: Stat) -> Case:
    return Case(
        id=name,
        bag=uri,
        bag_version=found.version,
        window=_NO_WINDOW,
        connections=[],
        ranges=[(0, found.size)],
        messages=0,
    )


def _names(uris: list[str]) -> list[str]:
    """A readable name per file: without its ending, or with it where two would share one; then with
    a mark. What another file's name is changes none of those that share nothing with it.
    """
    stems = Counter(map(_stem, uris))
    names = [_stem(uri) if stems[_stem(uri)] == 1 else _base(uri) for uri in uris]
    taken = Counter(names)
    return [
        name if taken[name] == 1 else f"{name}.{mark_of(uri)}"
        for name, uri in zip(names, uris, strict=True)
    ]


def _base(uri: str) -> str:
    return plain(posixpath.basename(uri), "file")


def _stem(uri: str) -> str:
    return posixpath.splitext(_base(uri))[0]
