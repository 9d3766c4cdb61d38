"""Which backend a URI means. The only place that knows schemes.

A claim is mounted into driver and executors; `pvc://<claim>/<path>` is the path below its
mount. Libraries of remote storage are imported when a URI first needs them.
"""

import os
import posixpath
from functools import lru_cache

from bagpipe.storage.backend import Backend
from bagpipe.storage.environment import take_over_secrets
from bagpipe.storage.faults import StorageError, storage_errors
from bagpipe.storage.local import LocalBackend
from bagpipe.storage.retries import Patience
from bagpipe.storage.servers import check_server

_OBJECTS = {"s3", "gs", "az", "https", "http"}


def locate(uri: str, volumes: dict[str, str], patience: Patience) -> tuple[Backend, str]:
    """A URI's backend and the path that it knows. Raises StorageError."""
    scheme, _, rest = uri.partition("://")
    authority, _, path = rest.partition("/")
    if scheme == "pvc":
        if authority not in volumes:
            raise StorageError(f"{uri}: the claim {authority} is not mounted in this pod")
        return LocalBackend(volumes[authority]), posixpath.join(volumes[authority], path)
    if scheme == "file":
        return LocalBackend("/"), rest
    if scheme in _OBJECTS or scheme == "hdfs":
        with storage_errors(uri, "used"):
            return _remote(scheme, authority, patience, os.getpid()), path
    raise StorageError(
        f"{uri} has no known scheme: write pvc://, file://, s3://, hdfs://, gs://, az:// or https://"
    )


def restore(pattern: str, path: str, volumes: dict[str, str]) -> str:
    """The URI of a path that a pattern matched, in the pattern's own words."""
    scheme, _, rest = pattern.partition("://")
    authority = rest.partition("/")[0]
    if scheme == "pvc":
        path = posixpath.relpath(path, volumes[authority])
    return f"{scheme}://{path}" if scheme == "file" else f"{scheme}://{authority}/{path}"


@lru_cache(maxsize=64)
def _remote(scheme: str, authority: str, patience: Patience, _process: int) -> Backend:
    """One for each bucket or NameNode, whose connections are kept; another after a fork."""
    take_over_secrets()
    check_server(scheme, authority, os.environ)
    if scheme == "hdfs":
        from bagpipe.storage.hdfs import HdfsBackend  # noqa: PLC0415

        return HdfsBackend(authority, patience)
    from bagpipe.storage.objects import ObjectBackend  # noqa: PLC0415

    return ObjectBackend(scheme, authority, patience)
