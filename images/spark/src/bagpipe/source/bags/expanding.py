"""The recordings that a source's patterns stand for: files, and folders of rosbag2."""

import posixpath

from bagpipe.plan.bag_tail import BagError
from bagpipe.plan.made import Unplanned
from bagpipe.plan.rosbag2 import METADATA, is_folder, read_metadata
from bagpipe.source.expanding import expanded
from bagpipe.storage import Storage, StorageError


def recordings(patterns: list[str], storage: Storage) -> tuple[list[str], list[Unplanned]]:
    """The URIs, each once, and a word on each pattern without any.

    A folder stands there by its metadata.yaml, also where the pattern names or matches the folder
    alone. The files that its metadata names are then none of their own: they would be played twice.
    """
    uris: list[str] = []
    unplanned: list[Unplanned] = []
    for pattern in patterns:
        # On object storage there is no folder: there are names that begin alike.
        wanted = f"{pattern}{METADATA}" if pattern.endswith("/") else pattern
        found, missing = expanded([wanted], storage, "BagMissing")
        if missing and wanted == pattern:
            within, still_missing = expanded([f"{pattern}/{METADATA}"], storage, "BagMissing")
            found, missing = within, missing if still_missing else []
        uris += [uri for uri in found if uri not in uris]
        unplanned += missing
    return _without_members(uris, storage), unplanned


def _without_members(uris: list[str], storage: Storage) -> list[str]:
    members: set[str] = set()
    for uri in filter(is_folder, uris):
        folder = f"{posixpath.dirname(uri)}/"
        if any(other != uri and other.startswith(folder) for other in uris):
            try:
                members.update(read_metadata(uri, storage).files)
            except (BagError, StorageError):
                continue  # planning it says what is wrong
    return [uri for uri in uris if uri not in members]
