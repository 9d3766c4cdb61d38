"""Events that are kept until the API server has taken them, each object's in their order."""

import logging
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from typing import Protocol

from bagpipe_operator.api.objects import Json
from bagpipe_operator.cluster.client import ApiError
from bagpipe_operator.cluster.events import Note, Subject

logger = logging.getLogger(__name__)

# An object's transitions that wait for an API server which takes no Events.
MOST_NOTES = 20
# 401: our token is being renewed, or the API server can't check it; all other calls wait too.
_TRANSIENT = frozenset({0, 401, 429, 500, 502, 503, 504})


class Creator(Protocol):
    """What writing Events needs of an API server."""

    async def create(self, resource: str, manifest: Json) -> Json:
        """Creates a core/v1 object in its namespace; raises ApiError."""


@dataclass
class EventBacklog:
    """The Events to be written, by the UID of the object that they are about."""

    api: Creator
    _notes: dict[str, list[Note]] = field(default_factory=dict)

    def add(self, uid: str, notes: Iterable[Note]) -> None:
        """Keeps Events to be written."""
        kept = [*self._notes.get(uid, ()), *notes][-MOST_NOTES:]
        if kept:
            self._notes[uid] = kept

    async def write(self, about: Subject, manifest: Callable[[Note], Json]) -> None:
        """Writes what is kept; raises the ApiError after which to try again."""
        notes = self._notes.get(about.uid, [])
        while notes:
            try:
                await self.api.create("events", manifest(notes[0]))
            except ApiError as error:
                # A quota of Events answers 409 too, when another Event is counted meanwhile.
                conflict = error.status == 409 and not error.name_is_taken
                if error.status in _TRANSIENT or conflict:
                    raise
                if not error.name_is_taken:  # else it was written before, or its answer was lost
                    logger.warning(
                        "%s/%s: the event %s was not written: %s",
                        about.namespace, about.name, notes[0].reason, error,
                    )  # fmt: skip
            del notes[0]  # only now: a call that is cancelled is made again
        self.forget(about.uid)

    def keep_only(self, known: Iterable[str]) -> None:
        """Forgets all other objects."""
        self._notes = {uid: self._notes[uid] for uid in known if uid in self._notes}

    def forget(self, uid: str) -> None:
        """The object is gone, or all its Events are written."""
        self._notes.pop(uid, None)
