"""What POST /job brings to a driver that waits: only what claims the driver is read as a job.

Anybody who reaches the port may send anything, so a forgery costs little and writes little.
"""

import hashlib
import logging
import threading
import time
from collections.abc import Callable
from functools import partial

from pydantic import BaseModel, Field, ValidationError

from bagpipe.driver.seat import Offer, Seat
from bagpipe.installed import InstallationError
from bagpipe.spec import JobFile

# An operator offers a job five times in 10 s at most.
_MOST_LINES = 30
_LINES_SECONDS = 60.0

log = logging.getLogger(__name__)

# As the API server takes them: fit for a log, and no step to another path of the API.
_NAME = Field(pattern=r"^[a-z0-9]([a-z0-9.-]{0,251}[a-z0-9])?$")


class _Head(BaseModel):
    """Whose job a job.json says that it is; the rest is not looked at."""

    name: str = _NAME
    namespace: str = _NAME
    uid: str
    attempt: int = Field(ge=1)


class Offers:
    """Offers a seat to jobs that come as job.json."""

    def __init__(self, seat: Seat, monotonic: Callable[[], float] = time.monotonic) -> None:
        self._seat = seat
        self._monotonic = monotonic
        self._lock = threading.Lock()
        self._since, self._lines = monotonic(), 0

    def offered(self, description: bytes, sender: str) -> str:
        """Whether this driver runs the job of that job.json, which came from that address."""
        try:
            head = _Head.model_validate_json(description)
        except ValidationError as error:
            fault = error.errors(include_url=False, include_input=False)[0]
            where = ".".join(str(part) for part in fault["loc"])
            self._note("what %s offered is no job: %s %s", sender, where, fault["msg"])
            return "refused"
        digest = hashlib.sha256(description).hexdigest()
        read = partial(_job_of, description)
        answer = self._seat.offer(
            Offer(head.namespace, head.name, head.uid, head.attempt, digest, read, sender)
        )
        self._note("job %s/%s was offered: %s", head.namespace, head.name, answer)
        return answer

    def _note(self, line: str, *words: str) -> None:
        """Writes a line, of which there are so many in a minute: more would drive what the jobs
        write out of the log."""
        with self._lock:
            now = self._monotonic()
            if now - self._since >= _LINES_SECONDS:
                self._since, self._lines = now, 0
            self._lines += 1
            written = self._lines
        if written <= _MOST_LINES:
            log.info(line, *words)
        if written == _MOST_LINES:
            log.warning("further offers of this minute are not logged")


def _job_of(description: bytes) -> JobFile | None:
    """The job that its operator offers; None where this version of the driver can't read it."""
    try:
        return JobFile.model_validate_json(description)
    except (ValidationError, InstallationError) as error:
        log.warning("a job that claims this driver can't be read here: %.500r", str(error))
        return None
