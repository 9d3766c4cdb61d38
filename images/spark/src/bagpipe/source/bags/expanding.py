"""The recordings that a source's patterns stand for: files, and folders of rosbag2."""

from bagpipe.plan.made import Unplanned
from bagpipe.plan.rosbag2 import in_folders, without_members
from bagpipe.source.expanding import expanded
from bagpipe.storage import Storage


def recordings(patterns: list[str], storage: Storage) -> tuple[list[str], list[Unplanned]]:
    """The URIs, each recording once whatever links lead to it, and a word on patterns without any.

    A folder stands there by its metadata.yaml, also where the pattern names or matches the folder
    alone.
    """
    uris, unplanned = expanded(patterns, storage, "BagMissing", in_folders)
    return without_members(storage.each_once(uris), storage), unplanned
