"""Which namespaces have jobs without room, and since when. The clock comes in from outside."""

from dataclasses import dataclass, field
from datetime import datetime

from bagpipe_operator.jobs.pools.warm import Crowd


@dataclass
class Crowds:
    """Jobs that come one after the other are one crowd: a loop of them ends no pool twice."""

    rest_seconds: float
    """For how long a namespace must have had room until its next crowd is another."""

    _jobs: dict[str, tuple[str, bool]] = field(default_factory=dict)
    # By namespace, and whether on nodes: since when jobs have lacked room, and when one did last.
    _times: dict[tuple[str, bool], tuple[datetime, datetime]] = field(default_factory=dict)

    def note(self, uid: str, namespace: str, on_nodes: bool, now: datetime) -> None:
        """A job lacks room: on the nodes, or in its namespace's quota."""
        self._jobs[uid] = (namespace, on_nodes)
        for known, (_, last) in list(self._times.items()):
            if abs((now - last).total_seconds()) > self.rest_seconds:
                del self._times[known]
        since, _ = self._times.get((namespace, on_nodes), (now, now))
        self._times[namespace, on_nodes] = (since, now)

    def forget(self, uid: str) -> None:
        """A job has room, has ended, or is gone."""
        self._jobs.pop(uid, None)

    def now(self) -> list[Crowd]:
        """The crowds of jobs that lack room at present."""
        found = sorted(set(self._jobs.values()) & self._times.keys())
        return [Crowd(where[0], self._times[where][0], where[1]) for where in found]
