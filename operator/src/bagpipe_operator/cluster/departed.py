"""Which objects are gone for good, as long as an answer about one may be on its way.

The answer to a call may be processed after the event that reports the deletion. Nobody reports it
a second time, so what such an answer shows would be kept as if it were there.
"""

# An answer is awaited for seconds; no API server deletes more in that time.
MOST_DEPARTED = 10_000


class Departed:
    """The UIDs of the last MOST_DEPARTED objects that went. None is given to another object."""

    def __init__(self) -> None:
        self._uids: dict[str, None] = {}

    def __contains__(self, uid: str) -> bool:
        return uid in self._uids

    def add(self, uid: str) -> None:
        """One is gone."""
        self._uids.pop(uid, None)
        self._uids[uid] = None
        if len(self._uids) > MOST_DEPARTED:
            del self._uids[next(iter(self._uids))]
