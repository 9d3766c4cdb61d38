"""How often each of many waiting jobs may ask the API server, shared between namespaces first.

All together ask MOST_LOOKS_PER_SECOND times a second, since the API server has others to serve;
each namespace has the same part of that, however many jobs it has.
"""

from collections import Counter

MOST_LOOKS_PER_SECOND = 10.0


def seconds_between(waiting: int, namespaces: int, least: float) -> float:
    """After how long one of so many that wait in a namespace is asked about again."""
    return max(least, waiting * namespaces / MOST_LOOKS_PER_SECOND)


class FairShare:
    """The jobs that wait, by UID."""

    def __init__(self, least_seconds: float) -> None:
        self._least = least_seconds
        self._namespaces: dict[str, str] = {}
        self._waiting: Counter[str] = Counter()

    def add(self, uid: str, namespace: str) -> None:
        """A job waits."""
        if uid not in self._namespaces:
            self._namespaces[uid] = namespace
            self._waiting[namespace] += 1

    def remove(self, uid: str) -> None:
        """It waits no more."""
        namespace = self._namespaces.pop(uid, None)
        if namespace is not None:
            self._waiting[namespace] -= 1
            if not self._waiting[namespace]:
                del self._waiting[namespace]

    def seconds(self, namespace: str) -> float:
        """The time between two questions about one of a namespace's jobs."""
        return seconds_between(self._waiting[namespace], len(self._waiting), self._least)
