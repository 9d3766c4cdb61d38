"""obstore's errors as ours: sorted by whether asking again helps, and free of credentials.

A server's answer may quote the request, with its key and signature, and a URL may hold a
token; so of an error's text only the status, the S3 error code and the kind of a connection's
fault are passed on.
"""

import re
from collections.abc import Iterator
from contextlib import contextmanager

from obstore import exceptions

from bagpipe.storage.backend import ChangedError, TransientError

_STATUS = re.compile(r"status code: (\d{3})")
_CODE = re.compile(r"<Code>([A-Za-z]{1,64})</Code>")
_KIND = re.compile(r"kind: (Connect|Timeout|Request|Interrupted|Decode|Unknown)")
# Where clouds give credentials to their machines: asked when the environment has none.
_METADATA = re.compile(r"/latest/(api/token|meta-data)|/computeMetadata/|//169\.254\.")

_DENIED = (exceptions.PermissionDeniedError, exceptions.UnauthenticatedError)
_BUSY = {"408", "425", "429", "500", "502", "503", "504", "509"}
_BUSY_CODES = {
    "ConditionalRequestConflict",
    "IncompleteBody",
    "OperationAborted",
    "RequestTimeout",
    "SlowDown",
    "Throttling",
}
_KINDS = {
    "Connect": "no connection to the server",
    "Timeout": "the server did not answer in time",
    "Interrupted": "the connection broke",
    "Request": "the connection broke",
    "Decode": "the answer broke off",
    "Unknown": "the connection broke",
}

REFUSED = (
    "the credential was refused{detail}: check the Secrets of spec.storage.secrets, or the rights"
    " of the pods' service account"
)
NO_CREDENTIAL = (
    "there is no credential: name a Secret in spec.storage.secrets, or give the pods' service"
    " account a cloud identity"
)


@contextmanager
def asked() -> Iterator[None]:
    """Raises TransientError, FileNotFoundError or another OSError with a sentence."""
    try:
        yield
    except FileNotFoundError as error:
        raise FileNotFoundError(_not_found(str(error))) from None
    except OSError:
        raise
    except exceptions.BaseError as error:
        raise translated(error) from None
    except ValueError:
        # Its text quotes what it could not read.
        raise OSError(
            "the storage library can't read the path, which may have no empty part and no '.', or"
            " a setting beside it"
        ) from None


def translated(error: exceptions.BaseError) -> OSError:
    """The error to raise for one of obstore's."""
    text = str(error)
    status, code = _found(_STATUS, text), _found(_CODE, text)
    reply = " ".join(part for part in (status, code) if part)
    if isinstance(error, _DENIED) or status in {"401", "403"}:
        return OSError(REFUSED.format(detail=f" ({reply})" if reply else ""))
    if _METADATA.search(text):
        # A new pod's identity may take a moment to be there.
        return TransientError(NO_CREDENTIAL)
    if status:
        return _answered(status, code, reply)
    return _broken(error, text)


def _broken(error: exceptions.BaseError, text: str) -> OSError:
    """An error without an answer's status."""
    if isinstance(error, exceptions.NotSupportedError):
        return OSError("the server gives no ranges of its files: copy the bag to another storage")
    if "certificate" in text:
        return OSError("the server's certificate is not trusted: check the endpoint")
    kind = _found(_KIND, text)
    if kind:
        return TransientError(_KINDS[kind])
    return OSError(f"the storage library refused ({type(error).__name__}): check the URI")


def _answered(status: str, code: str, reply: str) -> OSError:
    if status in _BUSY or code in _BUSY_CODES:
        return TransientError(f"the server answered {reply}")
    if status == "404":
        return FileNotFoundError(f"the server answered {reply}")
    if status == "416":  # what is asked for lay in the file as it was planned
        return ChangedError(f"the server answered {reply}")
    return OSError(f"the server answered {reply}: check the URI, the endpoint and the region")


def _not_found(text: str) -> str:
    code = _found(_CODE, text)
    return f"the server answered 404 {code}" if code else "no such file"


def _found(pattern: re.Pattern[str], text: str) -> str:
    found = pattern.search(text)
    return found[1] if found else ""
