"""The files that a source's patterns stand for."""

from collections.abc import Callable

from bagpipe.plan.made import Unplanned
from bagpipe.source.naming import stem
from bagpipe.storage import Storage, StorageError


def _files(pattern: str, storage: Storage) -> list[str]:
    return storage.expand(pattern)


def expanded(
    patterns: list[str],
    storage: Storage,
    missing: str,
    named: Callable[[str, Storage], list[str]] = _files,
) -> tuple[list[str], list[Unplanned]]:
    """The URIs, each once, and a word on each pattern without any; `missing` is its reason.

    `named` gives the URIs of one pattern.
    """
    uris: dict[str, None] = {}
    unplanned: list[Unplanned] = []
    for pattern in patterns:
        try:
            found = named(pattern, storage)
        except (StorageError, OSError) as error:
            unplanned.append(Unplanned(stem(pattern), pattern, missing, str(error)))
            continue
        if not found:
            message = f"no file at {pattern}: check the name and volume"
            unplanned.append(Unplanned(stem(pattern), pattern, missing, message))
        uris |= dict.fromkeys(found)
    return list(uris), unplanned
