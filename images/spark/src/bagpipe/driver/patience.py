"""Waiting for storage that may come back: a full volume, a server that restarts."""

import logging
import threading
import time
from collections.abc import Callable
from typing import TypeVar

from bagpipe.driver.progress import Progress
from bagpipe.storage import StorageError, StorageUnfitError

# A full volume may be emptied by a person; a job that can't keep its results for so long ends.
PATIENCE_SECONDS = 300.0
_PAUSE_SECONDS = 2.0

_never = threading.Event()

log = logging.getLogger(__name__)

_Done = TypeVar("_Done")


def patiently(
    action: Callable[[], _Done],
    progress: Progress,
    clock: Callable[[], float] = time.monotonic,
    pause: Callable[[float], object] = _never.wait,
) -> _Done:
    """The action's answer, tried for up to 300 s. Raises the last StorageError after that.

    StorageUnfitError comes at once: no waiting helps.
    """
    begun = clock()
    while True:
        try:
            return action()
        except StorageUnfitError:
            raise
        except StorageError as error:
            if clock() - begun >= PATIENCE_SECONDS:
                raise
            log.warning("tried again in %.0f s: %s", _PAUSE_SECONDS, error)
            progress.warn(f"The results can't be kept at the moment: {error}")
        pause(_PAUSE_SECONDS)
