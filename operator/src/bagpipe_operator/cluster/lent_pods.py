"""Whether a job's own pods may still run another job: they would go with it.

Asked of the API server, as an operator that starts may not know yet of the one that runs there.
"""

from bagpipe_operator.api import names
from bagpipe_operator.cluster.client import Objects, get_if_there


async def may_lend_pods(api: Objects, namespace: str, driver: str, uid: str) -> bool:
    """Whether the driver that was made for an ended job, by its UID, is there and may run.

    Without a driver's name there is none. Raises ApiError for faults that may pass.
    """
    pod = await get_if_there(api, "pods", namespace, driver) if driver else None
    if pod is None:
        return False
    meta = pod["metadata"]
    made_for = (meta.get("labels") or {}).get(names.LABEL_JOB_UID)
    ended = (pod.get("status") or {}).get("phase") in {"Succeeded", "Failed"}
    return made_for == uid and not ended and not meta.get("deletionTimestamp")
