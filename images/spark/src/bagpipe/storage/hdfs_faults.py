"""hdfs-native's errors as ours, and a deadline for calls that have none."""

import re
import threading
from collections.abc import Callable
from typing import TypeVar

from bagpipe.storage.backend import ChangedError, TransientError

T = TypeVar("T")

_HADOOP = re.compile(r"org\.apache\.hadoop\.[A-Za-z.$]*?([A-Z][A-Za-z]*Exception)")
_DENIED = {"AccessControlException", "AuthorizationException", "InvalidToken"}
# A NameNode that starts, that is not the active one, or that waits for a block before it gives the
# next, will answer later.
_BUSY = {
    "NotReplicatedYetException",
    "RetriableException",
    "SafeModeException",
    "ServerTooBusyException",
    "StandbyException",
}
_PERMANENT = re.compile(
    r"^(InvalidPath|InvalidArgument|UrlParseError|UnsupportedFeature|UnsupportedErasureCoding)"
)
_CREDENTIAL = re.compile(r"^(SASLError|GSSAPIError|NoSASLMechanism)")
REFUSED = (
    "the user was refused{detail}: check HADOOP_USER_NAME in the Secrets of spec.storage.secrets,"
    " and the folder's permissions"
)


def within(seconds: float, ask: Callable[[], T]) -> T:
    """What `ask` answers, in a thread that is left behind when it takes longer.

    Raises TransientError, FileNotFoundError, FileExistsError or another OSError.
    """
    answers: list[T] = []
    errors: list[BaseException] = []

    def run() -> None:
        try:
            answers.append(ask())
        except BaseException as error:  # noqa: BLE001  raised again in the caller's thread
            errors.append(error)

    thread = threading.Thread(target=run, name="hdfs", daemon=True)
    thread.start()
    thread.join(seconds)
    if errors:
        raise translated(errors[0]) from None
    if not answers:
        raise TransientError(f"HDFS did not answer in {seconds:g} s")
    return answers[0]


def translated(error: BaseException) -> BaseException:
    """The error to raise for one of hdfs-native's; its text may be a whole Java stack."""
    if isinstance(error, ChangedError):
        return error
    if isinstance(error, FileNotFoundError):
        return FileNotFoundError("no such file")
    if isinstance(error, FileExistsError):
        return FileExistsError("there is one already")
    text = str(error)
    found = _HADOOP.search(text)
    name = found[1] if found else ""
    refused = isinstance(error, PermissionError) or "InvalidToken" in text
    if refused or name in _DENIED or _CREDENTIAL.search(text):
        return OSError(REFUSED.format(detail=f" ({name})" if name else ""))
    if name:
        kind = TransientError if name in _BUSY else OSError
        return kind(f"HDFS answered {name}")
    return _broken(error, text)


def _broken(error: BaseException, text: str) -> OSError:
    permanent = _PERMANENT.search(text)
    if permanent or type(error).__name__ == "PanicException":
        what = permanent[1] if permanent else "PanicException"
        return OSError(f"the HDFS library refused ({what}): check the URI")
    return TransientError("the connection to HDFS broke or was refused")
