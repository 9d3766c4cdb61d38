"""A job's claim to a driver that waits in a pool, as it stands in the job's status. Pure.

Pods keep the labels, names and owner of the job that they were made for: the API server lets a
driver make pods of its own job alone. A job that has taken a driver over runs in that one's pods.
"""

from dataclasses import dataclass
from datetime import datetime
from typing import Literal, get_args

from bagpipe_operator.api import conditions, names, readings
from bagpipe_operator.api.objects import Json

State = Literal["Offered", "Taken", "Fenced"]
COLD = "Cold"


@dataclass(frozen=True)
class Claim:
    """Which driver a job has asked for, and how far that is."""

    driver: str
    """The UID of the driver's pod."""

    since: datetime
    state: State = "Offered"
    pod: str = ""
    """The pod's name."""

    job: str = ""
    """The job that the pod was made for, with its UID and its attempt."""

    uid: str = ""
    attempt: int = 1
    digest: str = ""
    """SHA-256 of job.json, in hexadecimal digits."""

    def as_status(self, pool: str) -> Json:
        """The job's status.pool."""
        return {
            "name": pool,
            "state": self.state,
            "driver": self.driver,
            "pod": self.pod,
            "job": self.job,
            "uid": self.uid,
            "attempt": self.attempt,
            "digest": self.digest,
            "since": conditions.timestamp(self.since),
        }


def claim_of(status: Json) -> Claim | None:
    """The claim in a status. Only a job's first attempt runs in others' pods."""
    found = readings.mapping(status.get("pool"))
    states: dict[object, State] = {state: state for state in get_args(State)}
    state, since = states.get(found.get("state")), readings.moment(found.get("since"))
    if state is None or since is None or int(status.get("attempt") or 1) != 1:
        return None
    keys = ("driver", "pod", "job", "uid", "digest")
    texts = {key: str(found.get(key) or "") for key in keys}
    return Claim(since=since, state=state, attempt=int(found.get("attempt") or 1), **texts)


def taken(status: Json) -> Claim | None:
    """The claim of a job that runs, or has run, in a driver's pods of another job."""
    claim = claim_of(status)
    return claim if claim is not None and claim.state == "Taken" else None


def is_asked_for(status: Json) -> bool:
    """Whether a driver was asked to run the job, and it is not known whether it does."""
    claim = claim_of(status)
    return claim is not None and claim.state != "Taken"


def driver_name(job: str, attempt: int, status: Json) -> str:
    """The pod's name of an attempt's driver."""
    claim = taken(status)
    return claim.pod if claim and attempt == 1 else names.driver_name(job, attempt)
