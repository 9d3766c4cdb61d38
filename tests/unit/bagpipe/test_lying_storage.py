"""Storage with wrong answers: the winner gets "taken", the loser "created".

The real ones can't be made to lie, so these are stand-ins for what was seen of them: an NFS server
that repeats a link, an object store that does not know the condition, one that keeps no metadata.
The real S3 server's own tests are in tests/integration/storage.
"""

import errno
import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

import obstore
import pytest
from obstore.store import MemoryStore

from bagpipe.driver import job as driver
from bagpipe.driver.progress import Progress
from bagpipe.driver.results import Results
from bagpipe.storage import Patience, Storage, StorageError, StorageUnfitError
from bagpipe.storage.backend import TransientError
from bagpipe.storage.hdfs import HdfsBackend
from bagpipe.storage.objects import ObjectBackend
from tests.unit.bagpipe.jobs import make_job
from tests.unit.bagpipe.places import By, nothing
from tests.unit.bagpipe.test_hdfs_rename import NameNode, backend

LINK = Path.hardlink_to
QUICK = Patience(tries=2, first_pause_seconds=0)


def linking(monkeypatch: pytest.MonkeyPatch, link: Callable[[Path, Path], None]) -> None:
    monkeypatch.setattr(Path, "hardlink_to", link)


def made_and_denied(code: int) -> Callable[[Path, Path], None]:
    """The link is made; what comes back is that it was not."""

    def link(path: Path, target: Path) -> None:
        LINK(path, target)
        raise OSError(code, os.strerror(code))

    return link


@pytest.fixture
def storage(tmp_path: Path) -> Storage:
    return Storage({"r": str(tmp_path)}, QUICK)


@pytest.mark.parametrize("code", [errno.EEXIST, errno.EIO, errno.ETIMEDOUT, errno.EPERM])
def test_a_link_that_was_made_counts_whatever_its_answer_says(
    storage: Storage, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, code: int
) -> None:
    with monkeypatch.context() as patch:
        linking(patch, made_and_denied(code))
        assert storage.put_once("pvc://r/job/manifest.json", b"mine")
    assert not storage.put_once("pvc://r/job/manifest.json", b"other")
    assert storage.names("pvc://r/job") == ["manifest.json"]
    assert (tmp_path / "job/manifest.json").read_bytes() == b"mine"
    assert (tmp_path / "job/manifest.json").stat().st_nlink == 1


@pytest.mark.parametrize("count", [1, 2])
def test_a_loser_stays_one_also_where_the_winner_s_file_is_the_same(
    storage: Storage, tmp_path: Path, count: int
) -> None:
    assert storage.put_once("pvc://r/manifest.json", b"same")
    for other in range(count - 1):
        LINK(tmp_path / f"other{other}", tmp_path / "manifest.json")
    assert not storage.put_once("pvc://r/manifest.json", b"same")


def test_a_link_that_fails_and_is_not_there_is_an_error(
    storage: Storage, monkeypatch: pytest.MonkeyPatch
) -> None:
    def refuse(_path: Path, _target: Path) -> None:
        raise OSError(errno.EIO, os.strerror(errno.EIO))

    linking(monkeypatch, refuse)
    with pytest.raises(StorageError, match="Input/output error"):
        storage.put_once("pvc://r/manifest.json", b"mine")
    assert storage.names("pvc://r") == []


class Server(ObjectBackend):
    """An object store in memory, and how it lies."""

    def __init__(self) -> None:
        self._writable = True
        self._patience = QUICK
        self._store = MemoryStore()
        self.conditions = True
        self.metadata = True
        self.lose: list[str] = []
        self.puts = 0

    def put(self, store: Any, path: str, data: bytes, **options: Any) -> Any:
        self.puts += 1
        lost = self.lose.pop(0) if self.lose else ""
        if lost == "before":
            raise obstore.exceptions.GenericError("kind: Timeout")
        mode: Any = options["mode"] if self.conditions else "overwrite"
        attributes = options["attributes"] if self.metadata else {}
        obstore_put(store, path, data, mode=mode, attributes=attributes, use_multipart=False)
        if lost == "after":
            raise obstore.exceptions.GenericError("kind: Interrupted")


obstore_put = obstore.put
MANIFEST = "s3://bucket/job/manifest.json"


@pytest.fixture
def server(monkeypatch: pytest.MonkeyPatch) -> Server:
    made = Server()
    monkeypatch.setattr("bagpipe.storage.kinds._remote", lambda *_: made)
    monkeypatch.setattr("bagpipe.storage.objects.obstore.put", made.put)
    return made


@pytest.fixture
def objects(server: Server) -> Storage:  # noqa: ARG001  the bucket's server
    return Storage({}, QUICK)


@pytest.mark.parametrize("metadata", [True, False])
@pytest.mark.parametrize("lost", ["", "before", "after"])
def test_an_object_whose_answer_is_lost_is_its_writer_s(
    server: Server, objects: Storage, metadata: bool, lost: str
) -> None:
    server.metadata = metadata
    server.lose = [lost] if lost else []
    assert objects.put_once(MANIFEST, b"driver one")
    assert server.puts == (2 if lost else 1)
    assert not objects.put_once(MANIFEST, b"driver two")
    assert objects.read_all(MANIFEST, 100) == b"driver one"


def test_an_object_that_is_taken_and_gone_is_asked_for_again(
    server: Server, objects: Storage, monkeypatch: pytest.MonkeyPatch
) -> None:
    taken = [obstore.exceptions.AlreadyExistsError("412")]

    def put(*arguments: Any, **options: Any) -> None:
        if taken:
            raise taken.pop()
        server.put(*arguments, **options)

    monkeypatch.setattr("bagpipe.storage.objects.obstore.put", put)
    assert objects.put_once(MANIFEST, b"driver one")


def test_a_server_without_the_condition_is_refused_when_the_job_begins(
    server: Server, objects: Storage
) -> None:
    objects.check_put_once("s3://bucket/job")
    server.conditions = False
    with pytest.raises(StorageUnfitError) as refused:
        objects.check_put_once("s3://bucket/job")
    assert str(refused.value) == (
        "s3://bucket/job can't hold results: its storage replaced a file that was to be created"
        " only where there is none (on object stores: a put with If-None-Match: *), so two drivers"
        " could both count. Write spec.output.uri on another storage, or a server's version that"
        " keeps the condition"
    )
    # Neither probe leaves anything.
    assert objects.names("s3://bucket/job") == []


def test_a_job_on_such_a_server_fails_before_it_plans(
    server: Server, monkeypatch: pytest.MonkeyPatch
) -> None:
    server.conditions = False
    monkeypatch.setattr("bagpipe.driver.patience._never", None)  # nothing is waited for
    job = make_job({}, output={"uri": "s3://bucket/out"})
    progress = Progress("s3://bucket/out/drive/uid-1")

    class Never(By):
        def planned(self, *_arguments: object) -> Any:
            raise AssertionError("planned")

    assert not driver.ended(progress, lambda: driver.run(job, progress, place=Never(nothing)))
    assert progress.reason == "StorageFailed"
    assert "two drivers could both count" in progress.message


def test_a_volume_without_links_is_refused_when_the_job_begins(
    storage: Storage, monkeypatch: pytest.MonkeyPatch
) -> None:
    def refuse(_path: Path, _target: Path) -> None:
        raise OSError(errno.EPERM, os.strerror(errno.EPERM))

    linking(monkeypatch, refuse)
    with pytest.raises(StorageUnfitError, match="the volume's file system has no hard links"):
        storage.check_put_once("pvc://r/job")
    assert storage.names("pvc://r/job") == []


def test_a_volume_that_waits_is_no_unfit_one(
    storage: Storage, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(_path: Path, _target: Path) -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    linking(monkeypatch, full)
    with pytest.raises(StorageError, match="No space left") as refused:
        storage.check_put_once("pvc://r/job")
    assert not isinstance(refused.value, StorageUnfitError)


class Repeating(NameNode):
    """The library asks a second NameNode by itself, which finds the rename done."""

    def __init__(self, second: type[Exception]) -> None:
        super().__init__()
        self.second = second

    def rename(self, source: str, target: str, overwrite: bool) -> None:
        super().rename(source, target, overwrite)
        if self.second is FileExistsError:
            raise FileExistsError(target)
        raise FileNotFoundError(source)


@pytest.mark.parametrize("second", [FileExistsError, FileNotFoundError])
def test_a_rename_that_was_done_counts_whatever_its_answer_says(
    monkeypatch: pytest.MonkeyPatch, second: type[Exception]
) -> None:
    node = Repeating(second)
    hdfs: HdfsBackend = backend(node, monkeypatch)
    assert hdfs.put_once("jobs/manifest.json", b"mine", "writer-1")
    assert node.files == {"/jobs/manifest.json": b"mine"}
    assert not hdfs.put_once("jobs/manifest.json", b"other", "writer-2")
    assert node.files == {"/jobs/manifest.json": b"mine"}


def test_a_manifest_that_can_t_be_read_back_counts_for_nobody(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A driver that believed its own would remove what the real winner recorded."""
    results = Results(make_job({"results": str(tmp_path)}), Storage({"results": str(tmp_path)}))
    monkeypatch.setattr(Storage, "put_once", lambda *_: False)

    class Rows:
        def rows(self) -> list[Any]:
            return []

    rows: Any = Rows()
    with pytest.raises(StorageError, match=r"manifest\.json was put and is not there"):
        results.commit(rows, Progress(results.folder), "me")


def test_a_loser_removes_nothing_by_a_manifest_of_its_own(tmp_path: Path) -> None:
    storage = Storage({"results": str(tmp_path)})
    results = Results(make_job({"results": str(tmp_path)}), storage)
    with storage.create(f"{results.folder}/cases/a.bag") as file:
        file.write(b"counts")
    mine = {"driver": "mine", "cases": []}
    with pytest.raises(StorageError, match="no recording was removed"):
        results._remove_uncounted(mine)
    storage.put_once(
        f"{results.folder}/manifest.json", b'{"driver": "theirs", "cases": [], "counts": {}}'
    )
    with pytest.raises(StorageError, match="no recording was removed"):
        results._remove_uncounted(mine)
    assert storage.names(f"{results.folder}/cases") == ["a.bag"]


def test_storage_that_never_answers_is_reported_as_such(server: Server, objects: Storage) -> None:
    server.lose = ["before"] * 9
    with pytest.raises(StorageError, match="2 tries") as refused:
        objects.put_once(MANIFEST, b"x")
    assert refused.value.may_pass
    assert isinstance(refused.value.__cause__.__cause__, TransientError)  # type: ignore[union-attr]
