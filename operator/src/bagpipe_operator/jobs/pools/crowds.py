"""Which namespaces have jobs without room, and since when. The clock comes in from outside."""

from dataclasses import dataclass, field
from datetime import datetime

from bagpipe_operator.jobs.pools.warm import Crowd

# A namespace, and whether the nodes have no room: else its quota.
_Where = tuple[str, bool]


@dataclass
class Crowds:
    """Jobs that come one after the other are one crowd for so long: a loop of jobs that no node can
    hold ends the pools of others once in that time, and one that waits for ever is no crowd to
    those that come later."""

    lasts_seconds: float
    """For how long jobs that come belong to the crowd of the first."""

    _jobs: dict[str, _Where] = field(default_factory=dict)
    _since: dict[_Where, datetime] = field(default_factory=dict)

    def note(self, uid: str, namespace: str, on_nodes: bool, now: datetime) -> None:
        """A job lacks room: on the nodes, or in its namespace's quota."""
        where = (namespace, on_nodes)
        if self._jobs.get(uid) == where:
            return
        over = [known for known, since in self._since.items() if self._is_over(since, now)]
        for known in over:
            if known == where or known not in self._jobs.values():
                del self._since[known]
        self._jobs[uid] = where
        self._since.setdefault(where, now)

    def forget(self, uid: str) -> None:
        """A job has room, has ended, or is gone."""
        self._jobs.pop(uid, None)

    def now(self) -> list[Crowd]:
        """The crowds of jobs that lack room at present."""
        found = sorted(set(self._jobs.values()))
        return [Crowd(where[0], self._since[where], where[1]) for where in found]

    def _is_over(self, since: datetime, now: datetime) -> bool:
        return abs((now - since).total_seconds()) > self.lasts_seconds
