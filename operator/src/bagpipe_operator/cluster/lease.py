"""Who leads, by a Lease of coordination.k8s.io: what to do next. Pure; election.py does it.

The machines' clocks may differ, so no moment written in a Lease is ever compared with ours.
A Lease runs out when it has not been written for its duration, by the watcher's own clock. The
holder counts from before it asked for its last renewal and stops after two thirds of that time,
so it has stopped before anybody can take over, as long as clocks run equally fast.
"""

from dataclasses import dataclass
from enum import Enum, auto

from bagpipe_operator.api.objects import Json

API_VERSION = "coordination.k8s.io/v1"


class Step(Enum):
    """What to do about the Lease."""

    CREATE = auto()
    TAKE = auto()
    RENEW = auto()
    WAIT = auto()


@dataclass(frozen=True)
class Terms:
    """The candidate's name, unique to its process, and the Lease's duration."""

    identity: str
    duration_seconds: int

    @property
    def work_seconds(self) -> float:
        """How long a renewal lets its holder work; the rest is for what is still under way."""
        return self.duration_seconds * 2 / 3

    @property
    def period_seconds(self) -> float:
        """How often it is renewed, and looked at; also the deadline of one look."""
        return self.duration_seconds / 5


@dataclass(frozen=True)
class Lease:
    """A Lease as it was read; `version` changes with every write."""

    version: str
    holder: str
    duration_seconds: int
    acquired: str
    transitions: int

    @classmethod
    def from_object(cls, lease: Json) -> "Lease":
        """A Lease as the API server sends it; one that nobody has filled is free."""
        spec = lease.get("spec") or {}
        return cls(
            version=str(lease["metadata"]["resourceVersion"]),
            holder=spec.get("holderIdentity") or "",
            duration_seconds=int(spec.get("leaseDurationSeconds") or 0),
            acquired=spec.get("acquireTime") or "",
            transitions=int(spec.get("leaseTransitions") or 0),
        )


@dataclass(frozen=True)
class Sighting:
    """The last version of the Lease and since when it has been that one, by our clock."""

    version: str = ""
    since: float = 0.0

    def of(self, lease: Lease, now: float) -> "Sighting":
        """The sighting after a look; the same one when nobody has written."""
        return self if lease.version == self.version else Sighting(lease.version, now)


@dataclass(frozen=True)
class Decision:
    """The step, and for WAIT the seconds until the next look."""

    step: Step
    pause_seconds: float = 0.0


def decide(terms: Terms, lease: Lease | None, sighting: Sighting, now: float) -> Decision:
    """What a candidate does that sees this Lease (None: there is none), seen like this."""
    if lease is None:
        # Somebody has deleted it, and who held it may not know yet.
        left = sighting.since + terms.duration_seconds - now if sighting.version else 0.0
        if left > 0:
            return Decision(Step.WAIT, min(terms.period_seconds, left))
        return Decision(Step.CREATE)
    if lease.holder == terms.identity:
        return Decision(Step.RENEW)
    if not lease.holder:
        return Decision(Step.TAKE)
    left = sighting.since + (lease.duration_seconds or terms.duration_seconds) - now
    if left <= 0:
        return Decision(Step.TAKE)
    return Decision(Step.WAIT, min(terms.period_seconds, left))


def manifest(
    namespace: str, name: str, terms: Terms, step: Step, lease: Lease | None, moment: str
) -> Json:
    """The Lease as its new or old holder writes it; `moment` is only for people to read."""
    kept = lease is not None and step is Step.RENEW
    meta: Json = {"namespace": namespace, "name": name}
    if lease is not None:
        # Whoever has written meanwhile makes this one answer 409.
        meta["resourceVersion"] = lease.version
    return {
        "apiVersion": API_VERSION,
        "kind": "Lease",
        "metadata": meta,
        "spec": {
            "holderIdentity": terms.identity,
            "leaseDurationSeconds": terms.duration_seconds,
            "acquireTime": lease.acquired if lease is not None and kept else moment,
            "renewTime": moment,
            "leaseTransitions": lease.transitions + (0 if kept else 1) if lease else 0,
        },
    }


def released(namespace: str, name: str, lease: Lease, moment: str) -> Json:
    """The Lease without a holder: the next look of any candidate takes it."""
    return {
        "apiVersion": API_VERSION,
        "kind": "Lease",
        "metadata": {"namespace": namespace, "name": name, "resourceVersion": lease.version},
        "spec": {
            "holderIdentity": "",
            "leaseDurationSeconds": 1,
            "renewTime": moment,
            "leaseTransitions": lease.transitions,
        },
    }
