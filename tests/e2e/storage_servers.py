"""An S3 server and an HDFS that the cluster's pods reach, as processes at its first node's address.

They run in that node's network namespace, as its kubelet does: nothing listens on the machine.
"""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import hdfs_native
import pytest
from embedded import builds
from embedded.places import FIRST

from bagpipe.storage import kinds as storage_kinds
from tests.integration.storage.hdfs_server import hdfs
from tests.integration.storage.servers import (
    ACCESS_KEY,
    BUCKET,
    SECRET_KEY,
    Host,
    s3_server,
)

# Below the ports that connections take by themselves, so that they are free in the namespace.
_S3_PORT, _HDFS_PORTS = 21900, (21820, 21866)
_HDFS_USER = "fleet-of-the-tests"
NODE = Host(FIRST.address, FIRST.namespace)


@contextmanager
def s3_of_the_cluster(folder: Path) -> Iterator[tuple[str, dict[str, str]]]:
    """The URI of a bucket, and what a Secret must hold for it."""
    server = s3_server(builds.ensure(builds.S3_SERVER) / "versitygw", folder, NODE, _S3_PORT)
    login = {
        "AWS_ACCESS_KEY_ID": ACCESS_KEY,
        "AWS_SECRET_ACCESS_KEY": SECRET_KEY,
        "AWS_REGION": "us-east-1",
        "AWS_ENDPOINT_URL": server.url,
    }
    try:
        server.start()
        with _environment(login):
            yield f"s3://{BUCKET}", login
    finally:
        server.kill()


@contextmanager
def hdfs_of_the_cluster(folder: Path) -> Iterator[tuple[str, dict[str, str]]]:
    """The URI of a folder that belongs to one user, and what a Secret must hold for it."""
    found = hdfs(folder, NODE, _HDFS_PORTS)
    login = {"HADOOP_USER_NAME": _HDFS_USER}
    try:
        found.start()
        with _environment({"HADOOP_USER_NAME": "root"}):
            client = hdfs_native.Client(found.uri.removesuffix("/jobs"))
            client.mkdirs("/jobs", 0o700, True)
            client.set_owner("/jobs", _HDFS_USER)
        with _environment(login):
            yield found.uri, login
    finally:
        found.stop()


@contextmanager
def _environment(login: dict[str, str]) -> Iterator[None]:
    """This process has the login too, which puts recordings there and reads results."""
    with pytest.MonkeyPatch.context() as patch:
        for name, value in login.items():
            patch.setenv(name, value)
        storage_kinds._remote.cache_clear()
        yield
    storage_kinds._remote.cache_clear()
