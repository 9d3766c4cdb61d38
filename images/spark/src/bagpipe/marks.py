"""What users write on a job for the record (commit, branch), as its results keep it. Pure."""

from collections.abc import Mapping
from typing import Any

PREFIX = "sim.bagpipe.io/"
# A job.json holds it for the reader; a job that is made from that file is another.
PROVENANCE = f"{PREFIX}provenance"
_MOST_CHARACTERS = 1000


def marks_of(
    labels: Mapping[str, Any], annotations: Mapping[str, Any]
) -> dict[str, dict[str, str]]:
    """A job's `labels`, and its `annotations` below `sim.bagpipe.io/`.

    Others' annotations may hold anything, kubectl's the whole manifest.
    """
    ours = {
        str(key): str(value)[:_MOST_CHARACTERS]
        for key, value in annotations.items()
        if str(key).startswith(PREFIX) and key != PROVENANCE
    }
    return {"labels": {str(k): str(v) for k, v in labels.items()}, "annotations": ours}
