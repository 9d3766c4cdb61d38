"""Calls of the cluster's API server, with the account of the driver's own pod."""

import json
import ssl
import urllib.request
from collections.abc import Mapping
from http.client import HTTPException
from pathlib import Path
from typing import Any

API_SERVER = "https://kubernetes.default.svc"
ACCOUNT = Path("/var/run/secrets/kubernetes.io/serviceaccount")
_PATIENCE_SECONDS = 10.0
# A driver that is deleted has half a minute for all that it does then.
_DELETE_SECONDS = 3.0


def get_json(
    path: str,
    server: str = API_SERVER,
    account: Path = ACCOUNT,
    patience_seconds: float = _PATIENCE_SECONDS,
) -> Any:
    """The answer to a GET. Raises OSError (an HTTPError where it is refused), and ValueError for an
    answer that is not JSON."""
    return _call("GET", path, None, server, account, patience_seconds)


def delete(path: str, options: Mapping[str, Any], server: str, account: Path) -> None:
    """Delete what is at a path, one object or those of a selector. Raises as `get_json` does."""
    _call("DELETE", path, json.dumps(options).encode(), server, account, _DELETE_SECONDS)


def _call(
    method: str,
    path: str,
    body: bytes | None,
    server: str,
    account: Path,
    patience_seconds: float,
) -> Any:
    tls = ssl.create_default_context(cafile=str(account / "ca.crt")) if "https" in server else None
    # No proxy of the environment: this is the cluster's own server.
    handlers = [urllib.request.ProxyHandler({}), urllib.request.HTTPSHandler(context=tls)]
    opener = urllib.request.build_opener(*handlers)
    token = (account / "token").read_text().strip()
    request = urllib.request.Request(  # noqa: S310  our own server
        f"{server}{path}",
        body,
        {"Authorization": f"Bearer {token}", "Content-Type": "application/json"},
        method=method,
    )
    try:
        with opener.open(request, timeout=patience_seconds) as answer:
            return json.load(answer)
    except HTTPException as error:
        # An answer that is cut off, or is no HTTP: of no kind that who asks would expect.
        raise OSError(f"{path}: {type(error).__name__}: {error}") from error
