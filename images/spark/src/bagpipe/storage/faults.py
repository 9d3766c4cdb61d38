"""What storage says when it refuses."""

from collections.abc import Iterator
from contextlib import contextmanager

from bagpipe.storage.backend import ChangedError


class StorageError(Exception):
    """Storage refused; the sentence names the URI as the user wrote it."""


@contextmanager
def told(uri: str, done: str) -> Iterator[None]:
    """Turn a backend's errors into StorageError: `uri` can't be `done` ("read", "written")."""
    try:
        yield
    except ChangedError as error:
        raise StorageError(
            f"{uri} is no longer the file that was planned: it was replaced or appended to; run"
            " the job again when nothing writes to it"
        ) from error
    except OSError as error:
        raise StorageError(f"{uri} can't be {done}: {error.strerror or error}") from error
