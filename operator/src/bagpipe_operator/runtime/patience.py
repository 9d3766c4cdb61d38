"""Since when something has been seen without a break, per job.

Kubelets say what is wrong but not since when, so the operator remembers it; after a restart of
the operator the time starts at zero again, which only ever delays a failure.
"""

from collections.abc import Hashable, Iterable


class Patience:
    """First sightings by job and thing; times are any clock's seconds."""

    def __init__(self) -> None:
        self._since: dict[str, dict[Hashable, float]] = {}

    def observe(self, uid: str, seen: Iterable[Hashable], now: float) -> dict[Hashable, float]:
        """Seconds for which each seen thing has been there; what is not seen is forgotten."""
        before = self._since.get(uid, {})
        after = {thing: before.get(thing, now) for thing in seen}
        if after:
            self._since[uid] = after
        else:
            self._since.pop(uid, None)
        return {thing: now - since for thing, since in after.items()}

    def forget(self, uid: str) -> None:
        """Drops a job."""
        self._since.pop(uid, None)
