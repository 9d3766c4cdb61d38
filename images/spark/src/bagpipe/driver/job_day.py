"""The day on which a job's quarantine is looked at: that on which its first driver began.

It is put beside the results once. So a job that runs over midnight, goes on after a suspension, or
whose driver was lost has one answer, whichever clock the next driver's node has.
"""

import json
import posixpath
from datetime import UTC, date, datetime

from bagpipe.storage import Storage, StorageUnfitError

FILE = "quarantine.json"
_SCHEMA = "sim.bagpipe.io/quarantine/v1alpha1"
_MOST_BYTES = 1 << 16


def job_day(storage: Storage, folder: str, began: float) -> date:
    """The job's day in UTC; `began` are seconds since 1970. Raises StorageError."""
    uri = posixpath.join(folder, FILE)
    today = datetime.fromtimestamp(began, UTC).date().isoformat()
    if not storage.exists(uri):
        storage.put_once(uri, json.dumps({"schema": _SCHEMA, "day": today}).encode())
    try:
        return date.fromisoformat(json.loads(storage.read_all(uri, _MOST_BYTES))["day"])
    except (ValueError, TypeError, KeyError) as error:
        raise StorageUnfitError(
            f"{uri} does not say on which day the job began ({error!r}): remove it, and its"
            " quarantine is looked at again"
        ) from error
