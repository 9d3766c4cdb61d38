"""Whether a job is this driver's, as the job's own status says, and whether it still is."""

import logging
import os
import signal
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any
from urllib.error import HTTPError
from urllib.parse import quote

from bagpipe.driver.api_server import ACCOUNT, API_SERVER, get_json
from bagpipe.driver.beside import Beside
from bagpipe.driver.seat import Claimed, LookUp
from bagpipe.spec import JobFile

_JOBS = "/apis/sim.bagpipe.io/v1alpha1/namespaces"
# In a state beside these the operator has given the driver up.
_STATES = frozenset({"Offered", "Taken"})
# Shorter than the operator's own deadline for an answer.
_PATIENCE_SECONDS = 1.5
_LOOK_SECONDS = 5.0

log = logging.getLogger(__name__)


def claim_of(
    namespace: str, name: str, server: str = API_SERVER, account: Path = ACCOUNT
) -> Claimed | None:
    """The claim in a job's status; None where it has none, or where there is no such job.

    Raises OSError where nobody answers.
    """
    path = f"{_JOBS}/{quote(namespace)}/simulationjobs/{quote(name)}"
    try:
        job = get_json(path, server, account, _PATIENCE_SECONDS)
    except HTTPError as error:
        if error.code == 404:
            return None
        raise
    except ValueError as error:
        raise OSError(f"{path}: {error}") from error
    return _claim_in(job)


def _claim_in(job: Mapping[str, Any]) -> Claimed | None:
    status = job.get("status") or {}
    pool = status.get("pool") or {}
    if pool.get("state") not in _STATES or job["metadata"].get("deletionTimestamp"):
        return None
    attempt = int(status.get("attempt") or 1)
    return Claimed(job["metadata"]["uid"], attempt, pool.get("driver", ""), pool.get("digest", ""))


class StillClaimed(Beside):
    """Asks while a block runs whether the job still claims this driver: `with StillClaimed(...)`.

    The pods of a job that was deleted go with it, but for those that were made for another job.
    """

    def __init__(
        self,
        job: JobFile,
        driver: str,
        look_up: LookUp,
        interrupt: Callable[[], None] = lambda: os.kill(os.getpid(), signal.SIGTERM),
        every_seconds: float = _LOOK_SECONDS,
    ) -> None:
        super().__init__("claim", every_seconds, self._goes_on)
        self._job, self._driver = job, driver
        self._look_up, self._interrupt = look_up, interrupt

    def _goes_on(self) -> bool:
        if self._is_ours() or self.is_over:
            return True
        log.warning("job %s no longer claims this driver, which ends", self._job.name)
        self._interrupt()
        return False

    def _is_ours(self) -> bool:
        try:
            claim = self._look_up(self._job.name)
        except OSError as error:
            log.warning("the claim of job %s can't be looked up: %s", self._job.name, error)
            return True
        wanted = (self._job.uid, self._job.attempt, self._driver)
        return claim is not None and (claim.uid, claim.attempt, claim.driver) == wanted
