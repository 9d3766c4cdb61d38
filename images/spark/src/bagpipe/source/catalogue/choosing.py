"""The recordings of a job that names a catalogue, by a process of bounded memory and time."""

import hashlib
import json
import os
import signal
import subprocess
import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from bagpipe.plan.made import Selection
from bagpipe.source.catalogue.faults import CatalogueError
from bagpipe.source.catalogue.selecting import Choice
from bagpipe.storage import Storage, StorageError

MOST_BYTES = 256 << 20
_PIECE_BYTES = 1 << 20
# Of what its process is given of this one's environment: no credential is among it.
_KEPT = ("PATH", "PYTHONPATH", "LD_LIBRARY_PATH", "LANG", "TMPDIR")


@dataclass(frozen=True)
class Bounds:
    """Of the process that reads a catalogue: bytes of memory, and seconds."""

    memory: int = 512 << 20
    seconds: int = 120


def chosen(
    choice: Choice, storage: Storage, bounds: Bounds | None = None
) -> tuple[list[str], Selection]:
    """The selected URIs, and what is to be reported of the selection. Raises CatalogueError."""
    bounds = bounds or Bounds()
    with tempfile.NamedTemporaryFile(prefix="bagpipe-catalogue-") as file:
        sha256 = _fetched(choice.uri, storage, Path(file.name))
        found = _asked(choice, Path(file.name), bounds)
    return found["uris"], Selection(
        choice.uri, choice.where, sha256, found["rows"], found["selected"], len(found["uris"])
    )


def _fetched(uri: str, storage: Storage, path: Path) -> str:
    """Puts the file there; its SHA-256 in hexadecimal digits."""
    digest = hashlib.sha256()
    try:
        source = storage.open(uri)
        if source.size > MOST_BYTES:
            raise CatalogueError(
                f"{uri} has {source.size:,} bytes, and a catalogue may have {MOST_BYTES:,}: leave"
                " out columns that are not asked for, or split it"
            )
        with path.open("wb") as file:
            for piece in source.pieces([(0, source.size)], _PIECE_BYTES):
                digest.update(piece)
                file.write(piece)
    except StorageError as error:
        raise CatalogueError(f"source.catalogue.uri can't be read: {error}") from error
    return digest.hexdigest()


def _asked(choice: Choice, path: Path, bounds: Bounds) -> dict[str, Any]:
    request = {
        "choice": vars(choice) | {"within": list(choice.within)}, "path": str(path),
        "memory": bounds.memory, "seconds": bounds.seconds,
    }  # fmt: skip
    environment = {key: os.environ[key] for key in _KEPT if key in os.environ}
    # Arrow's own allocator reserves more than it uses.
    environment["ARROW_DEFAULT_MEMORY_POOL"] = "system"
    what = f"source.catalogue.where ({choice.where[:200]}) over {choice.uri}"
    try:
        done = subprocess.run(
            [sys.executable, "-P", "-m", "bagpipe.source.catalogue.process"],
            input=json.dumps(request).encode(), capture_output=True, check=False,
            timeout=bounds.seconds + 5, env=environment,
        )  # fmt: skip
    except subprocess.TimeoutExpired:
        raise CatalogueError(_too_long(what, bounds)) from None
    if done.returncode == -signal.SIGXCPU:
        raise CatalogueError(_too_long(what, bounds))
    try:
        found: dict[str, Any] = json.loads(done.stdout)
    except ValueError:
        found = {"memory": True}
    if "memory" in found:
        last = done.stderr.decode("utf-8", "replace").strip().splitlines()[-1:]
        raise CatalogueError(
            f"{what} takes more than {bounds.memory >> 20} MiB of memory, or its reader broke"
            f" ({done.returncode}): write smaller cells, or smaller row groups"
            f"{f' ({last[0][:200]})' if last else ''}"
        )
    if "fault" in found:
        raise CatalogueError(found["fault"])
    return found


def _too_long(what: str, bounds: Bounds) -> str:
    return f"{what} takes longer than {bounds.seconds} s: write a simpler expression, or fewer rows"
