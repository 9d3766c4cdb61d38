"""What storage says when it refuses."""

from collections.abc import Iterator
from contextlib import contextmanager

from bagpipe.storage.backend import ChangedError, TransientError, UnfitError


class StorageError(Exception):
    """Storage refused; the sentence names the URI as the user wrote it."""

    @property
    def may_pass(self) -> bool:
        """Whether storage did not answer, also when asked again, rather than refused."""
        cause = self.__cause__
        while cause is not None and not isinstance(cause, TransientError):
            cause = cause.__cause__
        return cause is not None


class StorageUnfitError(StorageError):
    """Waiting changes nothing: storage of this kind can't hold results, or what a job has kept
    there can't be used any more.
    """


@contextmanager
def storage_errors(uri: str, done: str) -> Iterator[None]:
    """Turn a backend's errors into StorageError: `uri` can't be `done` ("read", "written")."""
    try:
        yield
    except OSError as error:
        raise refusal(error, uri, done) from error


def refusal(error: OSError, uri: str, done: str) -> StorageError:
    """What a backend's error is to the one who asked: `uri` can't be `done`."""
    if isinstance(error, ChangedError):
        return StorageError(
            f"{uri} is no longer the file that was planned: it was replaced or appended to; run"
            " the job again when nothing writes to it"
        )
    sentence = f"{uri} can't be {done}: {error.strerror or error}"
    return StorageUnfitError(sentence) if isinstance(error, UnfitError) else StorageError(sentence)
