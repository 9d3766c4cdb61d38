"""What somebody inside a namespace can make of a job's children: pods, statuses, accounts.

A pod's status is fuzzed by the same walk as a CRD's, over the part of its schema that the operator
reads.
"""

import json
import random
from typing import Any

from bagpipe_operator.api import names
from tests.fuzz.manifests import schema as schemas
from tests.fuzz.manifests import values
from tests.fuzz.manifests.values import Json

_STRING = {"type": "string"}
_TIME = {"type": "string", "format": "date-time"}


def _record(**properties: Any) -> dict[str, Any]:
    return {"type": "object", "properties": properties}


def _list(items: Any) -> dict[str, Any]:
    return {"type": "array", "items": items}


def _one_of(*words: str) -> dict[str, Any]:
    return {"type": "string", "enum": list(words)}


_ENDED = _record(
    exitCode={"type": "integer", "minimum": 0, "maximum": 255},
    reason=_one_of("OOMKilled", "Error", "Completed", "x"),
    message=_STRING,
    startedAt=_TIME,
    finishedAt=_TIME,
)
_WAITING = _record(
    reason=_one_of("ImagePullBackOff", "CrashLoopBackOff", "CreateContainerConfigError", "x"),
    message=_STRING,
)
_CONTAINER = _record(
    name=_one_of("driver", "spark-kubernetes-executor", "agent", "stack", "stack-1", "other"),
    image=_STRING,
    imageID=_STRING,
    ready={"type": "boolean"},
    restartCount={"type": "integer"},
    state=_record(waiting=_WAITING, running=_record(startedAt=_TIME), terminated=_ENDED),
    lastState=_record(terminated=_ENDED),
)
_CONDITION = _record(
    type=_one_of("PodScheduled", "DisruptionTarget", "Ready", "ContainersReady"),
    status=_one_of("True", "False", "Unknown"),
    reason=_one_of("EvictionByEvictionAPI", "SchedulingGated", "PreemptionByScheduler", "x"),
    message=_STRING,
    lastTransitionTime=_TIME,
)
POD_STATUS = _record(
    phase=_one_of("Pending", "Running", "Succeeded", "Failed", "Unknown"),
    reason=_one_of("Evicted", "NodeLost", "x", ""),
    message=_STRING,
    podIP=_one_of("10.0.0.5", "127.0.0.1", "::1", "fe80::1"),
    conditions=_list(_CONDITION),
    containerStatuses=_list(_CONTAINER),
    initContainerStatuses=_list(_CONTAINER),
)


def account(rng: random.Random) -> str:
    """A driver's account: as a driver writes it, with fields of any value, or no account at all."""
    account: Json = {
        "phase": rng.choice(("Planning", "Running", "Complete", "Failed")),
        "reason": rng.choice(("", "SparkGone", "DriverFailed", "x" * 300)),
        "message": rng.choice(values.TEXTS),
        "cases": {"planned": rng.choice(values.NUMBERS), "passed": 1},
        "ledger": {"sent": 1, "received": rng.choice(values.NUMBERS)},
        "verdict": rng.choice(("Passed", "Failed", "Invalid", "")),
        "verdictReason": rng.choice(values.TEXTS),
        "results": rng.choice(values.URIS),
        "failures": [{"case": "a", "reason": "b", "message": rng.choice(values.TEXTS)}] * 7,
        "uid": "",
    }
    if rng.random() < 0.3:
        account[rng.choice([*account])] = values.tree(rng)
    if rng.random() < 0.1:
        return rng.choice(('{"phase":', "[" * 3_000, "NaN", "{}", "null", '"\\ud800"', "9" * 4_000))
    return json.dumps(account)


def pod_status(rng: random.Random) -> Json:
    """The status of a driver's or an executor's pod."""
    status = _filled(rng, POD_STATUS)
    for container in status.get("containerStatuses") or []:
        ended = (container.get("state") or {}).get("terminated")
        if ended is not None and rng.random() < 0.7:
            ended["message"] = account(rng)
    return status


def _filled(rng: random.Random, schema: Json, field: str = "") -> Json:
    """Most fields, mostly valid; a tenth of the words and moments are hostile."""
    match schema["type"]:
        case "object":
            shown = {k: v for k, v in schema["properties"].items() if rng.random() < 0.8}
            # The API server writes an empty name where there is none.
            named = {"name": ""} if "name" in schema["properties"] else {}
            return named | {k: _filled(rng, v, k) for k, v in shown.items()}
        case "array":
            return [_filled(rng, schema["items"], field) for _ in range(rng.randrange(4))]
    if rng.random() < 0.1:
        return values.hostile(rng, schema["type"], "time" if "format" in schema else field)
    if "format" in schema:
        return rng.choice((*values.MOMENTS[:4], "2026-11-20T04:00:00Z", "2026-11-21T04:00:00Z"))
    return schemas.valid(rng, schema)


def metadata(rng: random.Random, job: str, uid: str) -> Json:
    """Labels and owner of a child of a job, as its driver's pod has them, or nearly."""
    role = rng.choice(("driver", "driver", "executor", "", "x"))
    attempt = rng.choice(("1", "1", "2", "0", "-1", "9" * 60, "", "a"))
    labels = {str(k): str(v) for k, v in names.labels(job, uid, role, 1).items()}
    labels[names.LABEL_ATTEMPT] = attempt
    name = f"{job}-{rng.choice(('1', '2', attempt or '3'))}-{rng.choice(('driver', 'exec-1', 'x'))}"
    made: Json = {"name": name[:200].lower(), "labels": labels}
    if rng.random() < 0.7:
        made["ownerReferences"] = [names.owner_reference(job, uid)]
    if rng.random() < 0.2:
        made["annotations"] = rng.choice(values.ANNOTATIONS)
    return made


def pod(rng: random.Random, job: str, uid: str) -> Json:
    """A pod that claims to be a job's, as whoever may create pods there writes it."""
    volume = {"name": "v", "persistentVolumeClaim": {"claimName": rng.choice(("recordings", "x"))}}
    container = {"name": rng.choice(("driver", "stack")), "image": "example/image:1"}
    return {
        "apiVersion": "v1",
        "kind": "Pod",
        "metadata": metadata(rng, job, uid),
        "spec": {"containers": [container], "volumes": [volume] if rng.random() < 0.3 else []},
    }


def config_map(rng: random.Random, job: str, uid: str) -> Json:
    """A ConfigMap that claims to be a job's."""
    return {
        "apiVersion": "v1",
        "kind": "ConfigMap",
        "metadata": metadata(rng, job, uid),
        "data": {"job.json": account(rng), "executor.yaml": rng.choice(values.TEXTS)},
    }
