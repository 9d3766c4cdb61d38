"""A list of hosts, before real servers: what it does not allow never sees a connection."""

import json
import logging
import socket
import threading
from collections.abc import Iterator
from pathlib import Path

import pytest

from bagpipe.driver import __main__ as driver
from bagpipe.storage import Storage, StorageError
from bagpipe.storage import kinds as storage_kinds
from bagpipe.storage_hosts import VARIABLE
from tests.integration.storage.conftest import QUICK
from tests.integration.storage.servers import ACCESS_KEY, BUCKET, SECRET_KEY, S3Server
from tests.unit.bagpipe.jobs import make_job

# What obstore needs to take it for a key file; it asks no one for a token then.
GOOGLE_KEY = (
    '{{"gcs_base_url": "https://{}", "disable_oauth": true, "private_key": "",'
    ' "private_key_id": "", "client_email": ""}}'
)


class Listener:
    """Counts who connects, and hangs up."""

    def __init__(self) -> None:
        self._socket = socket.create_server(("127.0.0.1", 0))
        self.server = f"127.0.0.1:{self._socket.getsockname()[1]}"
        self.connections = 0
        threading.Thread(target=self._accept, daemon=True).start()

    def _accept(self) -> None:
        while True:
            try:
                connection, _ = self._socket.accept()
            except OSError:
                return
            self.connections += 1
            connection.close()

    def close(self) -> None:
        """End the thread, too."""
        self._socket.shutdown(socket.SHUT_RDWR)
        self._socket.close()


@pytest.fixture
def listener() -> Iterator[Listener]:
    found = Listener()
    yield found
    found.close()


@pytest.fixture
def variables(monkeypatch: pytest.MonkeyPatch) -> Iterator[pytest.MonkeyPatch]:
    """An environment of its own, and no connection that knew another."""
    storage_kinds._remote.cache_clear()
    yield monkeypatch
    storage_kinds._remote.cache_clear()


@pytest.mark.parametrize("uri", ["http://{}/x.bag", "hdfs://{}/x.bag"])
def test_a_server_outside_of_the_list_sees_no_connection(
    uri: str, listener: Listener, variables: pytest.MonkeyPatch
) -> None:
    place = uri.format(listener.server)
    variables.setenv(VARIABLE, "localhost,127.0.0.1:1")
    for asked in (Storage({}, QUICK).exists, Storage({}, QUICK).open, Storage({}, QUICK).remove):
        with pytest.raises(StorageError, match="does not allow: use another"):
            asked(place)
    assert listener.connections == 0


@pytest.mark.parametrize(
    ("uri", "secret"),
    [
        ("s3://bucket/x", {"AWS_ENDPOINT_URL": "http://{}"}),
        ("gs://bucket/x", {"GOOGLE_SERVICE_ACCOUNT_KEY": GOOGLE_KEY}),
    ],
)
def test_a_secret_leads_nowhere_else(
    uri: str, secret: dict[str, str], listener: Listener, variables: pytest.MonkeyPatch
) -> None:
    for name, value in secret.items():
        # Set by the code under test, and so removed again after it.
        variables.setenv(name, "")
        variables.setenv(f"BAGPIPE_SECRET_0_{name}", value.format(listener.server))
    variables.setenv(VARIABLE, "s3.us-east-1.amazonaws.com,storage.googleapis.com")
    with pytest.raises(StorageError, match=r"leads to a server that .* does not allow") as refused:
        Storage({}, QUICK).put_once(uri, b"x")
    assert listener.server not in str(refused.value)
    assert listener.connections == 0


def test_a_job_with_such_a_bag_ends_with_a_sentence(
    listener: Listener,
    variables: pytest.MonkeyPatch,
    tmp_path: Path,
    caplog: pytest.LogCaptureFixture,
) -> None:
    variables.setenv("AWS_ENDPOINT_URL", "")
    variables.setenv("BAGPIPE_SECRET_0_AWS_ENDPOINT_URL", f"http://{listener.server}")
    variables.setenv(VARIABLE, "minio.lab")
    variables.setattr(driver, "PROGRESS_PORT", 0)
    caplog.set_level(logging.INFO)
    job = make_job({"results": str(tmp_path)}, source={"bags": ["s3://drives/a.bag"]})
    path = tmp_path / "job.json"
    path.write_text(job.model_dump_json(by_alias=True))
    assert driver.main(["--job", str(path)]) == 1
    (report,) = [r.getMessage() for r in caplog.records if r.getMessage().startswith("{")]
    ended = json.loads(report)
    assert (ended["phase"], ended["reason"]) == ("Failed", "BagMissing")
    assert "s3://drives/a.bag can't be used: AWS_ENDPOINT_URL leads to" in ended["message"]
    assert listener.connections == 0


def test_what_the_list_allows_is_read_and_written(
    s3: S3Server, s3_folder: str, variables: pytest.MonkeyPatch
) -> None:
    given = {
        "AWS_ACCESS_KEY_ID": ACCESS_KEY,
        "AWS_SECRET_ACCESS_KEY": SECRET_KEY,
        "AWS_ENDPOINT_URL": s3.url,
        VARIABLE: f"127.0.0.1:{s3.port}",
    }
    for name, value in given.items():
        variables.setenv(name, value)
    storage = Storage({}, QUICK)
    assert storage.put_once(f"{s3_folder}/x", b"x")
    assert storage.names(f"s3://{BUCKET}/{s3_folder.rpartition('/')[2]}") == ["x"]
