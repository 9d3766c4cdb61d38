"""What tests build or install once for each state of what it is made of, in the project's cache."""

import fcntl
import hashlib
import os
import shutil
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import TextIO

from tests.waiting import wait_until

# For what another process builds at this moment.
_WAIT_SECONDS = 1500.0


def cache() -> Path:
    """Where the project keeps what it has built and fetched."""
    return Path(os.environ.get("BAGPIPE_CACHE") or Path.home() / ".cache/bagpipe")


def made_once(
    name: str, state: bytes, make: Callable[[Path], None], wait_seconds: float = _WAIT_SECONDS
) -> Path:
    """The folder that `make` fills, of this `state`: made by one process while others wait for it.

    It is made where it stays, as what is installed may name its own path; one whose maker failed
    or was stopped is made again. Raises NotSeenError where another process takes too long, and
    what `make` raises.
    """
    folder = cache() / f"{name}-{hashlib.sha256(state).hexdigest()[:16]}"
    complete = folder / "complete"
    cache().mkdir(parents=True, exist_ok=True)
    with (cache() / f"{name}.lock").open("w") as lock:
        wait_until(lambda: _locked(lock), wait_seconds, f"another process makes {folder}", 0.1)
        if not complete.exists():
            shutil.rmtree(folder, ignore_errors=True)
            make(folder)
            complete.touch()
    return folder


def _locked(file: TextIO) -> bool:
    try:
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        return False
    return True


def state_of(files: Iterable[Path]) -> bytes:
    """What `made_once` takes as the state of these files: their names and all that is in them."""
    parts = [(file.name.encode(), hashlib.sha256(file.read_bytes())) for file in sorted(files)]
    return b"".join(name + b"\0" + content.digest() for name, content in parts)
