"""HDFS whose processes die, and which refuses a user: a real NameNode and a real DataNode."""

import threading
import time

import pytest

from bagpipe.storage import Patience, Storage, StorageError
from bagpipe.storage import kinds as storage_kinds
from bagpipe.storage.reading import REQUEST_BYTES
from tests.integration.storage.conftest import QUICK
from tests.integration.storage.hdfs_server import Hdfs
from tests.integration.storage.test_contract import MIB, pattern
from tests.waiting import PATIENCE

DATA = pattern(12 * REQUEST_BYTES)
# Outlives the start of a Java process on a busy machine, some 100 s of pauses.
PATIENT = Patience(20, 120, 0.2, 1)


@pytest.fixture
def bag(running_hdfs: Hdfs, credentials: pytest.MonkeyPatch, request: pytest.FixtureRequest) -> str:
    """A recording of 48 MiB, in three blocks."""
    del credentials
    uri = f"{running_hdfs.uri}/{request.node.name}/x.bag"
    with Storage({}, QUICK).create(uri) as file:
        file.write(DATA)
    return uri


def test_a_datanode_that_is_killed_and_comes_back_is_read_on(bag: str, running_hdfs: Hdfs) -> None:
    pieces = Storage({}, PATIENT).pieces(bag, [(0, len(DATA))], MIB)
    read = [next(pieces)]
    running_hdfs.datanode.kill()
    again = threading.Timer(0.5, running_hdfs.start_datanode)
    again.start()
    try:
        read += list(pieces)
    finally:
        again.join(2 * PATIENCE)
    assert b"".join(read) == DATA


def test_a_datanode_that_stays_away_is_an_error_that_names_the_byte(
    bag: str, running_hdfs: Hdfs
) -> None:
    file = Storage({}, Patience(20, 3, 0.05, 0.1)).open(bag)
    running_hdfs.datanode.kill()
    try:
        with pytest.raises(StorageError, match=r"at byte 777: the connection to HDFS .*\(3 tries"):
            file.read(777, 10)
    finally:
        running_hdfs.start_datanode()
    assert file.read(777, 10) == DATA[777:787]


def test_a_namenode_that_is_killed_is_met_again(bag: str, running_hdfs: Hdfs) -> None:
    storage = Storage({}, Patience(20, 2, 0.05, 0.1))
    running_hdfs.namenode.kill()
    begun = time.monotonic()
    with pytest.raises(StorageError, match="the connection to HDFS broke or was refused"):
        storage.put_once(f"{bag}.json", b"{}")
    assert time.monotonic() - begun < PATIENCE
    running_hdfs.start_namenode()
    patient = Storage({}, PATIENT)
    assert patient.read(bag, 0, 10) == DATA[:10]
    assert patient.put_once(f"{bag}.json", b"{}")


def test_a_user_without_rights_is_refused_at_once(
    bag: str, credentials: pytest.MonkeyPatch
) -> None:
    storage_kinds._remote.cache_clear()
    credentials.setenv("HADOOP_USER_NAME", "stranger")
    # A second try would have to wait for five minutes at least.
    storage = Storage({}, Patience(20, 50, 600, 600))
    begun = time.monotonic()
    with pytest.raises(
        StorageError, match=r"refused \(AccessControlException\): check HADOOP_USER"
    ):
        storage.put_once(f"{bag}.json", b"{}")
    assert time.monotonic() - begun < 2 * PATIENCE
