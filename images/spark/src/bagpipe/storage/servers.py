"""Which server a bucket, a container or a URI is on, and whether it is one that may be asked.

What leads to another server can come from a job's Secret, so it is read here as strictly as the
list of allowed hosts needs it, before a library makes a URL of it.
"""

import json
import re
from collections.abc import Mapping

from bagpipe.storage_hosts import SERVER, VARIABLE, allows, read_hosts

# The names by which obstore knows an endpoint; only the first can come from a Secret.
_ENDPOINTS = {
    "s3": ("AWS_ENDPOINT_URL", "AWS_ENDPOINT_URL_S3", "AWS_ENDPOINT"),
    "gs": ("GOOGLE_BASE_URL",),
    "az": ("AZURE_STORAGE_ENDPOINT", "AZURE_ENDPOINT"),
}
_REGIONS = ("AWS_REGION", "AWS_DEFAULT_REGION")
_GOOGLE_KEY = "GOOGLE_SERVICE_ACCOUNT_KEY"
_ACCOUNT = "AZURE_STORAGE_ACCOUNT_NAME"
_LABEL = re.compile(r"[A-Za-z0-9](?:[A-Za-z0-9-]{0,61}[A-Za-z0-9])?")
_BUCKET = re.compile(r"[A-Za-z0-9][A-Za-z0-9._-]*")
_URL = re.compile(r"(?P<scheme>https?)://(?P<server>[^/]+)(?:/.*)?", re.DOTALL)


def check_server(scheme: str, authority: str, environment: Mapping[str, str]) -> None:
    """Raises PermissionError for a server outside of the list, OSError for what names no server.

    The sentences name variables and not their values, which may be a Secret's.
    """
    entries = read_hosts(environment.get(VARIABLE, ""))
    for kind, server, origin in _servers(scheme, authority, environment):
        if SERVER.fullmatch(server) is None:
            raise OSError(f"{origin} names no server: write a host, and a port if it has one")
        if not allows(entries, kind, server):
            raise PermissionError(
                f"{origin} leads to a server that this installation does not allow: use another,"
                " or ask an administrator to add it to storage.allowedHosts of the Helm chart"
            )


def _servers(
    scheme: str, authority: str, environment: Mapping[str, str]
) -> list[tuple[str, str, str]]:
    """The servers that could be asked, each with its scheme and with what names it."""
    if scheme in _ENDPOINTS and _BUCKET.fullmatch(authority) is None:
        # Where a bucket is a part of its host's name, `#` or `/` in it would make another host.
        raise OSError("the URI names no bucket: write letters, digits, points and hyphens")
    # Also beside an endpoint: obstore shows the pod's web identity to sts.<region>.amazonaws.com.
    regions = _regions(environment) if scheme == "s3" else []
    endpoints = [name for name in _ENDPOINTS.get(scheme, ()) if environment.get(name)]
    if endpoints:
        return [_of_url(environment[name], name) for name in endpoints]
    if scheme == "s3":
        return [
            ("https", f"s3.{label}.amazonaws.com", origin)
            for label, origin in regions or [("us-east-1", "the bucket")]
        ]
    if scheme == "gs":
        return [_of_google(environment.get(_GOOGLE_KEY, ""))]
    if scheme == "az":
        account = environment.get(_ACCOUNT)
        # Without an account obstore says what it lacks.
        return [_of_azure(account)] if account else []
    return [(scheme, authority, "the URI")]


def _regions(environment: Mapping[str, str]) -> list[tuple[str, str]]:
    return [(_label(environment[name], name), name) for name in _REGIONS if environment.get(name)]


def _of_azure(account: str) -> tuple[str, str, str]:
    return "https", f"{_label(account, _ACCOUNT)}.blob.core.windows.net", _ACCOUNT


def _of_google(key: str) -> tuple[str, str, str]:
    """Google's own, or what a key file for another server names: obstore asks that."""
    try:
        content = json.loads(key) if key else {}
    except (ValueError, RecursionError):
        raise OSError(f"{_GOOGLE_KEY} holds no JSON: write the whole key file into it") from None
    if not isinstance(content, dict):
        # obstore takes a list for a key file too: the same fields in their order, without names.
        raise OSError(f"{_GOOGLE_KEY} holds no JSON object: write the whole key file into it")
    base = content.get("gcs_base_url")
    if base is not None:
        return _of_url(str(base), f"gcs_base_url in {_GOOGLE_KEY}")
    return "https", "storage.googleapis.com", "the bucket"


def _of_url(url: str, origin: str) -> tuple[str, str, str]:
    # A Secret's value often ends with a line's end, which libraries leave out.
    found = _URL.fullmatch(url.strip(" \t\r\n"))
    if found is None:
        raise OSError(f"{origin} is no URL: write http:// or https://, and a server")
    return found["scheme"], found["server"], origin


def _label(text: str, origin: str) -> str:
    """A part of a host's name; with a dot, slash or @ in it the host would be another."""
    if _LABEL.fullmatch(text) is None:
        raise OSError(f"{origin} holds more than letters, digits and hyphens: write the name alone")
    return text
