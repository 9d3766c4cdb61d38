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
    """Of jobs and schedules. `begun` is called when one more list of what was listed begins, or is
    refused: the rights are gone, and nothing that happens there is reported any more."""

    begun: Callable[[], None]
    _listed: set[str] = field(default_factory=set)

    def answered(self, answer: Answer) -> None:
        """One of kopf's calls was answered; one that was refused has listed nothing."""
        url, status = answer.url, answer.response.status
        follows = "watch" in url.query or "continue" in url.query
        if status not in {200, 403} or follows or not url.path.endswith(_KINDS):
            return
        if url.path in self._listed:
            what = "begins with a list again" if status == 200 else "has no rights any more"
            logger.info("the watch of %s %s", url.path, what)
            self.begun()
        elif status == 200:
            self._listed.add(url.path)
