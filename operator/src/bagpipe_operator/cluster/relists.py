"""Notices that kopf lists a kind again: what went since its last list or event is in none.

kopf does so after an expired watch, without a word and without an event of what is missing.
"""

import logging
from collections.abc import Callable
from dataclasses import dataclass, field

from bagpipe_operator.api import names
from bagpipe_operator.cluster.bounded_session import Answer

logger = logging.getLogger(__name__)

_KINDS = (f"/{names.PLURAL}", f"/{names.SCHEDULE_PLURAL}")


@dataclass
class Relists:
    """Of jobs and schedules. `begun` is called when one more list of what was listed begins, or
    when it, or its watch, is refused: the rights are gone, and nothing that happens there is
    reported any more."""

    begun: Callable[[], None]
    _listed: set[str] = field(default_factory=set)
    _refused: set[str] = field(default_factory=set)

    def answered(self, answer: Answer) -> None:
        """One of kopf's calls was answered; one that was refused has listed nothing."""
        url, status = answer.url, answer.response.status
        if not url.path.endswith(_KINDS):
            return
        if status == 403:
            if url.path in self._listed and url.path not in self._refused:
                self._refused.add(url.path)  # kopf asks again and again
                self._note(url.path, "has no rights any more")
        elif status == 200:
            self._refused.discard(url.path)
            if "watch" in url.query or "continue" in url.query:
                return
            if url.path in self._listed:
                self._note(url.path, "begins with a list again")
            self._listed.add(url.path)

    def _note(self, path: str, what: str) -> None:
        logger.info("the watch of %s %s", path, what)
        self.begun()
