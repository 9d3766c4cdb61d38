"""Servers that all storage tests share, and the places that the contract is tested on."""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import hdfs_native
import pytest
from embedded import builds

from bagpipe.storage import Patience, Storage
from bagpipe.storage import kinds as storage_kinds
from tests.integration.storage.faulty_proxy import FaultyProxy, faulty_proxy
from tests.integration.storage.hdfs_server import Hdfs, hdfs
from tests.integration.storage.servers import ACCESS_KEY, BUCKET, SECRET_KEY, S3Server, s3_server

# Short pauses, since the servers are on this machine; as many tries as jobs have, and more. None
# of them is to be given up only because the machine is slow.
QUICK = Patience(request_seconds=90, tries=12, first_pause_seconds=0.05, longest_pause_seconds=1)


@dataclass(frozen=True)
class Place:
    """A folder somewhere, empty at first."""

    storage: Storage
    uri: str


@pytest.fixture(scope="session")
def s3_binary() -> Path:
    """versitygw, built as the cluster's programs are, and kept in the same cache."""
    return builds.ensure(builds.S3_SERVER) / "versitygw"


@pytest.fixture(scope="session")
def s3(s3_binary: Path, tmp_path_factory: pytest.TempPathFactory) -> Iterator[S3Server]:
    """A running S3 server for the tests that leave it alone."""
    server = s3_server(s3_binary, tmp_path_factory.mktemp("s3"))
    server.start()
    yield server
    server.kill()


@pytest.fixture
def own_s3(s3_binary: Path, tmp_path: Path) -> Iterator[S3Server]:
    """A running S3 server for one test, which may kill it."""
    server = s3_server(s3_binary, tmp_path)
    server.start()
    yield server
    server.kill()


@pytest.fixture(scope="session")
def running_hdfs(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Hdfs]:
    """A running HDFS, whose folder /jobs belongs to the user bagpipe."""
    found = hdfs(tmp_path_factory.mktemp("hdfs"))
    try:
        found.start()
        with pytest.MonkeyPatch.context() as patch:
            patch.setenv("HADOOP_USER_NAME", "root")
            client = hdfs_native.Client(found.uri.removesuffix("/jobs"))
            client.mkdirs("/jobs", 0o755, True)
            client.set_owner("/jobs", "bagpipe")
        yield found
    finally:
        found.stop()


@pytest.fixture
def credentials(monkeypatch: pytest.MonkeyPatch) -> pytest.MonkeyPatch:
    """The environment that a job's Secret makes, and no connection that knew another."""
    storage_kinds._remote.cache_clear()
    monkeypatch.setenv("AWS_ACCESS_KEY_ID", ACCESS_KEY)
    monkeypatch.setenv("AWS_SECRET_ACCESS_KEY", SECRET_KEY)
    monkeypatch.setenv("AWS_REGION", "us-east-1")
    monkeypatch.setenv("HADOOP_USER_NAME", "bagpipe")
    return monkeypatch


@pytest.fixture
def proxy(s3: S3Server, credentials: pytest.MonkeyPatch) -> Iterator[FaultyProxy]:
    """The proxy for faults before the S3 server; jobs know only its address."""
    with faulty_proxy(s3.port) as found:
        credentials.setenv("AWS_ENDPOINT_URL", found.url)
        yield found


@pytest.fixture
def s3_folder(request: pytest.FixtureRequest) -> str:
    """A URI of the test's own."""
    return f"s3://{BUCKET}/{request.node.name.replace('[', '-').rstrip(']')}"


@pytest.fixture(params=["file", "pvc", "s3", "hdfs"])
def place(
    request: pytest.FixtureRequest,
    tmp_path: Path,
    s3_folder: str,
    credentials: pytest.MonkeyPatch,
) -> Place:
    """An empty folder of each kind of storage."""
    if request.param == "s3":
        credentials.setenv("AWS_ENDPOINT_URL", request.getfixturevalue("s3").url)
        return Place(Storage({}, QUICK), s3_folder)
    if request.param == "hdfs":
        server: Hdfs = request.getfixturevalue("running_hdfs")
        return Place(Storage({}, QUICK), f"{server.uri}/{s3_folder.rpartition('/')[2]}")
    if request.param == "pvc":
        return Place(Storage({"claim": str(tmp_path)}, QUICK), "pvc://claim/folder")
    return Place(Storage({}, QUICK), f"file://{tmp_path}/folder")
