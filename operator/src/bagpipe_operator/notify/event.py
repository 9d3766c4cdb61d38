"""The event as CloudEvents 1.0 has it: JSON, in structured mode, so that all is signed. Pure."""

import json
from datetime import datetime

from bagpipe_operator.api import names
from bagpipe_operator.api.conditions import timestamp
from bagpipe_operator.api.objects import Json

# The group of the API, the other way round.
TYPE_PREFIX = ".".join(reversed(names.GROUP.split("."))) + ".job"


def cloud_event(
    kind: str, namespace: str, name: str, identity: str, at: datetime, data: Json
) -> bytes:
    """The event about a job; `kind` is how it ended, one word."""
    event = {
        "specversion": "1.0",
        "id": identity,
        "type": f"{TYPE_PREFIX}.{kind}",
        "source": f"/apis/{names.API_VERSION}/namespaces/{namespace}/{names.PLURAL}",
        "subject": name,
        "time": timestamp(at),
        "datacontenttype": "application/json",
        "data": data,
    }
    return json.dumps(event, separators=(",", ":"), sort_keys=True).encode()
