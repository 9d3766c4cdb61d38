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
    # By namespace: since when jobs of it have lacked room, and when one did last.
    _times: dict[str, tuple[datetime, datetime]] = field(default_factory=dict)

    def note(self, uid: str, namespace: str, on_nodes: bool, now: datetime) -> None:
        """A job lacks room: on the nodes, or in its namespace's quota."""
        self._jobs[uid] = (namespace, on_nodes)
        for known, (_, last) in list(self._times.items()):
            if abs((now - last).total_seconds()) > self.rest_seconds:
                del self._times[known]
        since, _ = self._times.get(namespace, (now, now))
        self._times[namespace] = (since, now)

    def forget(self, uid: str) -> None:
        """A job has room, has ended, or is gone."""
        self._jobs.pop(uid, None)

    def now(self) -> list[Crowd]:
        """The crowds of jobs that lack room at present."""
        found = {(ns, on_nodes) for ns, on_nodes in self._jobs.values() if ns in self._times}
        return [Crowd(ns, self._times[ns][0], on_nodes) for ns, on_nodes in sorted(found)]
