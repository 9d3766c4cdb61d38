"""S3 that dies, is busy, breaks off, stalls, refuses: a real server, and a proxy that spoils it."""

import dataclasses
import threading
import time
import traceback

import pytest

from bagpipe.storage import Patience, Storage, StorageError
from bagpipe.storage.objects import _CHUNK_BYTES
from bagpipe.storage.reading import REQUEST_BYTES
from tests.integration.storage.conftest import QUICK
from tests.integration.storage.faulty_proxy import STALL_SECONDS, Fault, FaultyProxy
from tests.integration.storage.servers import ACCESS_KEY, BUCKET, SECRET_KEY, S3Server
from tests.integration.storage.test_contract import MIB, pattern
from tests.waiting import PATIENCE

DATA = pattern(3 * REQUEST_BYTES)


@pytest.fixture
def storage() -> Storage:
    return Storage({}, QUICK)


@pytest.fixture
def bag(proxy: FaultyProxy, storage: Storage, s3_folder: str) -> str:
    """A recording of 12 MiB, which takes three requests; the proxy has seen nothing yet."""
    uri = f"{s3_folder}/x.bag"
    assert storage.put_once(uri, DATA)
    proxy.seen.clear()
    return uri


@pytest.mark.parametrize("how", ["close", "reset"])
def test_an_answer_that_breaks_off_goes_on_at_its_byte(
    bag: str, storage: Storage, proxy: FaultyProxy, how: str
) -> None:
    proxy.faults["GET"] = [Fault(keep=1_500_000, how=how)]
    assert storage.read(bag, 0, REQUEST_BYTES) == DATA[:REQUEST_BYTES]
    first, second = proxy.ranges()
    assert first == f"0-{REQUEST_BYTES - 1}"
    begin, _, end = second.partition("-")
    # At most a chunk is read twice; a reset may also take along bytes that were on their way.
    lost = 1_500_000 - int(begin)
    assert 0 <= lost < (_CHUNK_BYTES if how == "close" else 1_500_001)
    assert int(end) == REQUEST_BYTES - 1


def test_a_busy_server_is_asked_again(bag: str, storage: Storage, proxy: FaultyProxy) -> None:
    proxy.faults["GET"] = [Fault(status=503)] * 5
    proxy.faults["HEAD"] = [Fault(status=503)] * 2
    pieces = storage.pieces(bag, [(0, len(DATA))], MIB)
    assert b"".join(pieces) == DATA
    assert (proxy.count("HEAD"), proxy.count("GET")) == (3, 3 + 5)


def test_a_server_that_stays_busy_is_an_error_with_all_details(
    bag: str, proxy: FaultyProxy
) -> None:
    file = Storage({}, Patience(PATIENCE, 12, 0.01, 0.05)).open(bag)
    proxy.faults["GET"] = [Fault(status=503)] * 100
    with pytest.raises(StorageError) as error:
        file.read(777, 10)
    assert str(error.value).startswith(
        f"{bag} can't be read: at byte 777: the server answered 503 SlowDown (12 tries in "
    )
    assert str(error.value).endswith(
        "check that the storage is up and reachable from the job's pods, then run the job again"
    )
    assert proxy.count("GET") == 12


def test_a_stalled_answer_is_given_up_at_its_deadline(bag: str, proxy: FaultyProxy) -> None:
    # Long enough for a whole answer on a busy machine, which may need a further try even so.
    seconds = 5.0
    storage = Storage({}, Patience(seconds, 12, 0.05, 0.1))
    proxy.faults["GET"] = [Fault(keep=1000, how="stall"), Fault(how="stall")]
    begun = time.monotonic()
    assert storage.read(bag, 0, 5000) == DATA[:5000]
    assert 2 * seconds - 0.1 < time.monotonic() - begun < STALL_SECONDS / 2
    assert proxy.ranges()[0] == "0-4999"
    assert proxy.count("GET") >= 3


def test_a_refused_credential_is_not_tried_again_and_not_disclosed(
    bag: str, proxy: FaultyProxy, credentials: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    wrong = "not-the-secret-of-this-server"
    credentials.setenv("AWS_SECRET_ACCESS_KEY", wrong)
    storage = Storage({}, Patience(PATIENCE, 4, 0.05, 0.1))
    caplog.set_level("DEBUG")
    for ask in (
        lambda: storage.read(bag, 0, 1),
        lambda: storage.put_once(f"{bag}.json", b"{}"),
        lambda: storage.expand(f"{bag.rpartition('/')[0]}/*"),
    ):
        proxy.seen.clear()
        with pytest.raises(StorageError, match="the credential was refused") as error:
            ask()
        assert len(proxy.seen) == 1
        assert "403" in str(error.value)
        assert "spec.storage.secrets" in str(error.value)
        # What a log of the error would hold, its causes included.
        logged = "".join(traceback.format_exception(error.value)) + caplog.text
        hidden = (wrong, SECRET_KEY, ACCESS_KEY, "SignatureProvided", "StringToSign")
        assert [text for text in hidden if text in logged] == []


def test_a_bucket_that_does_not_exist_is_not_tried_again(
    storage: Storage, proxy: FaultyProxy
) -> None:
    with pytest.raises(StorageError, match="can't be written: the server answered 404 NoSuchBuck"):
        storage.put_once("s3://no-such-bucket/manifest.json", b"{}")
    assert len(proxy.seen) == 1
    assert storage.expand("s3://no-such-bucket/x.bag") == []


def test_a_put_whose_answer_is_lost_is_still_ours(
    storage: Storage, proxy: FaultyProxy, s3_folder: str
) -> None:
    uri = f"{s3_folder}/manifest.json"
    proxy.faults["PUT"] = [Fault(how="reset")]
    assert storage.put_once(uri, b"mine")
    assert [one.status for one in proxy.seen if one.method == "PUT"] == [200, 412]
    assert not storage.put_once(uri, b"mine")


def test_parts_of_an_upload_are_sent_again(
    storage: Storage, proxy: FaultyProxy, s3_folder: str
) -> None:
    proxy.faults["PUT"] = [Fault(status=503), Fault(how="reset")]
    uri = f"{s3_folder}/x.bag"
    with storage.create(uri) as file:
        for at in range(0, len(DATA), MIB):
            file.write(DATA[at : at + MIB])
    assert storage.read_all(uri, len(DATA)) == DATA


def test_an_upload_that_fails_raises_and_leaves_nothing(
    proxy: FaultyProxy, s3: S3Server, s3_folder: str
) -> None:
    storage = Storage({}, Patience(PATIENCE, 2, 0.05, 0.1))
    proxy.faults["PUT"] = [Fault(status=503)] * 50
    with (
        pytest.raises(StorageError, match=r"x\.bag can't be written: the server answered 503"),
        storage.create(f"{s3_folder}/x.bag") as file,
    ):
        for at in range(0, len(DATA), MIB):
            file.write(DATA[at : at + MIB])
    assert storage.names(s3_folder) == []
    assert unfinished_uploads(s3) == []


def test_an_abandoned_upload_leaves_no_parts(
    storage: Storage, proxy: FaultyProxy, s3: S3Server, s3_folder: str
) -> None:
    with pytest.raises(ZeroDivisionError), storage.create(f"{s3_folder}/x.bag") as file:
        file.write(DATA + DATA)
        raise ZeroDivisionError
    assert proxy.count("PUT") >= 2
    assert storage.names(s3_folder) == []
    assert unfinished_uploads(s3) == []


def unfinished_uploads(s3: S3Server) -> list[str]:
    """Parts that versitygw keeps of uploads that were neither completed nor aborted."""
    kept = s3.root / BUCKET / ".sgwtmp" / "multipart"
    return [str(path) for path in kept.rglob("*") if path.is_file()]


def test_a_server_that_is_killed_and_comes_back_is_read_on(
    own_s3: S3Server, credentials: pytest.MonkeyPatch, s3_folder: str
) -> None:
    credentials.setenv("AWS_ENDPOINT_URL", own_s3.url)
    storage = Storage({}, dataclasses.replace(QUICK, tries=120))
    uri = f"{s3_folder}/x.bag"
    data = pattern(15 * REQUEST_BYTES)
    with storage.create(uri) as file:
        file.write(data)
    pieces = storage.pieces(uri, [(0, len(data))], MIB)
    read = [next(pieces)]
    own_s3.kill()
    again = threading.Timer(0.5, own_s3.start)
    again.start()
    try:
        read += list(pieces)
    finally:
        again.join(PATIENCE)
    assert b"".join(read) == data


def test_a_server_that_stays_away_is_an_error_in_bounded_time(
    own_s3: S3Server, credentials: pytest.MonkeyPatch, s3_folder: str
) -> None:
    credentials.setenv("AWS_ENDPOINT_URL", own_s3.url)
    own_s3.kill()
    storage = Storage({}, Patience(PATIENCE, 3, 0.05, 0.1))
    begun = time.monotonic()
    with pytest.raises(StorageError, match="no connection to the server"):
        storage.put_once(f"{s3_folder}/x", b"x")
    with pytest.raises(StorageError, match=r"no connection to the server \(3 tries in"):
        storage.expand(f"{s3_folder}/*.bag")
    assert time.monotonic() - begun < 2 * PATIENCE


def test_a_missing_credential_is_reported_as_missing(
    own_s3: S3Server, credentials: pytest.MonkeyPatch, s3_folder: str
) -> None:
    credentials.setenv("AWS_ENDPOINT_URL", own_s3.url)
    for name in ("AWS_ACCESS_KEY_ID", "AWS_SECRET_ACCESS_KEY"):
        credentials.delenv(name)
    # A port that nothing listens on, in place of a cloud's metadata service.
    credentials.setenv("AWS_METADATA_ENDPOINT", "http://127.0.0.1:9")
    storage = Storage({}, Patience(PATIENCE, 2, 0.05, 0.1))
    with pytest.raises(StorageError, match=r"there is no credential: name a Secret in spec\.st"):
        storage.read(f"{s3_folder}/x", 0, 1)
