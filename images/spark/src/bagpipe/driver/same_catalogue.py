"""The catalogue that a job's first driver selected recordings by: another driver goes by the same.

It is put beside the results once, as the day of a job's quarantine is.
"""

import dataclasses
import json
import posixpath

from bagpipe.plan.made import Selection
from bagpipe.source.catalogue.faults import CatalogueError
from bagpipe.storage import Storage, StorageUnfitError

FILE = "catalogue.json"
_SCHEMA = "sim.bagpipe.io/catalogue/v1alpha1"
_MOST_BYTES = 1 << 16


def check_selection(storage: Storage, folder: str, selection: Selection) -> None:
    """Raises CatalogueError where the catalogue has changed since the job began; StorageError."""
    uri = posixpath.join(folder, FILE)
    if not storage.exists(uri):
        document = {"schema": _SCHEMA} | dataclasses.asdict(selection)
        storage.put_once(uri, json.dumps(document, indent=1).encode())
    try:
        first = str(json.loads(storage.read_all(uri, _MOST_BYTES))["sha256"])
    except (ValueError, TypeError, KeyError) as error:
        raise StorageUnfitError(
            f"{uri} does not say by which catalogue the job began ({error!r}): create the job again"
        ) from error
    if first != selection.sha256:
        raise CatalogueError(
            f"{selection.catalogue} has changed since the job began (sha256 {first[:12]}, now"
            f" {selection.sha256[:12]}): create the job again, and leave a catalogue alone while"
            " jobs read it, for example by a new name for each version"
        )
