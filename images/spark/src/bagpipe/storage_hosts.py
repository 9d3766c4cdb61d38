"""The servers that storage may be on, where an administrator lists them.

The list is storage.allowedHosts of the Helm chart; without one every server is allowed. What a
listed server does is its administrator's: it may redirect, and a NameNode names its DataNodes.
"""

import re
from collections.abc import Sequence

# Comma-separated, in the operator's environment and in those of drivers and executors.
VARIABLE = "BAGPIPE_STORAGE_HOSTS"

_HOST = r"[A-Za-z0-9_](?:[A-Za-z0-9._-]*[A-Za-z0-9_])?\.?|\[[0-9A-Fa-f:.]+\]"
# Narrower than what URLs may be: two parsers of one odd URL may disagree on its host.
SERVER = re.compile(rf"(?P<host>{_HOST})(?::(?P<port>[0-9]{{1,5}}))?")
_ENTRY = re.compile(rf"(?P<host>(?:\*\.)?(?:{_HOST}))(?::(?P<port>[0-9]{{1,5}}))?")
_WITH_SERVER = re.compile(r"(https?|hdfs)://([^/]*)")
_USUAL_PORTS = {"http": "80", "https": "443", "hdfs": "8020"}


def read_hosts(text: str) -> tuple[str, ...]:
    """The entries of a list: host, *.domain, or either with :port. Raises ValueError for others."""
    entries = tuple(entry.strip().lower() for entry in text.split(",") if entry.strip())
    for entry in entries:
        if _ENTRY.fullmatch(entry) is None:
            raise ValueError(
                f"{entry!r} is no host: write for example s3.example.com, *.example.com or"
                " namenode:8020, without a scheme and a path"
            )
    return entries


def allows(entries: Sequence[str], scheme: str, server: str) -> bool:
    """Whether a list allows a server (host, or host:port); an empty list allows each.

    An entry without a port allows all ports; `*.example.com` allows the names below example.com, at
    any depth, and not example.com itself.
    """
    if not entries:
        return True
    found = SERVER.fullmatch(server)
    if found is None:
        return False
    host, port = _plain(found["host"]), found["port"] or _USUAL_PORTS.get(scheme, "443")
    return any(_matches(entry, host, port) for entry in entries)


def refused_uris(entries: Sequence[str], uris: Sequence[str]) -> list[str]:
    """Those of the URIs that name a server which a list does not allow.

    Where buckets are is not in their URIs: bagpipe.storage asks when it knows the server.
    """
    named = ((uri, _WITH_SERVER.match(uri)) for uri in uris)
    return [uri for uri, found in named if found and not allows(entries, found[1], found[2])]


def _matches(entry: str, host: str, port: str) -> bool:
    found = _ENTRY.fullmatch(entry)
    if found is None or found["port"] not in {None, port}:
        return False
    wanted = _plain(found["host"])
    return host.endswith(wanted[1:]) if wanted.startswith("*.") else host == wanted


def _plain(host: str) -> str:
    """A name as DNS compares it: without regard to case and to the root's dot."""
    return host.lower().removesuffix(".")
