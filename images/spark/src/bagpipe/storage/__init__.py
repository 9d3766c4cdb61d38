"""Where bags come from and results go: URIs, and nothing else that knows them.

`Storage` is the only door. A backend answers one request at a time; retries, read-ahead and
the sentences that users read are the same for all of them.
"""

from bagpipe.storage.backend import Stat
from bagpipe.storage.faults import StorageError, StorageUnfitError
from bagpipe.storage.reading import OpenFile
from bagpipe.storage.retries import Patience
from bagpipe.storage.storage import NewFile, Storage

__all__ = [
    "NewFile",
    "OpenFile",
    "Patience",
    "Stat",
    "Storage",
    "StorageError",
    "StorageUnfitError",
]
