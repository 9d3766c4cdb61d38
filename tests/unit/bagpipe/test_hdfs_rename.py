"""New files on HDFS where answers get lost: the NameNode's rename is what decides."""

from typing import Any

import pytest

from bagpipe.storage.backend import TransientError
from bagpipe.storage.hdfs import HdfsBackend
from bagpipe.storage.retries import Patience

RUNTIME_FAULT = RuntimeError("IOError: the connection was lost")


class NameNode:
    """Names and what they hold; `lose` are the renames whose answer is lost, before or after."""

    def __init__(self, *lose: str) -> None:
        self.files: dict[str, bytes] = {}
        self.lose = list(lose)

    def create(self, path: str, _options: Any) -> "NameNodeFile":
        return NameNodeFile(self, path)

    def get_file_info(self, path: str) -> str:
        if path not in self.files:
            raise FileNotFoundError(path)
        return path

    def delete(self, path: str, _recursive: bool) -> bool:
        return self.files.pop(path, None) is not None

    def rename(self, source: str, target: str, overwrite: bool) -> None:
        lost = self.lose.pop(0) if self.lose else ""
        if lost == "before":
            raise RUNTIME_FAULT
        if source not in self.files:
            # What hdfs-native makes of the NameNode's own word for it.
            raise RuntimeError("RPC error: java.io.FileNotFoundException: rename source")
        if target in self.files and not overwrite:
            raise FileExistsError(target)
        self.files[target] = self.files.pop(source)
        if lost == "after":
            raise RUNTIME_FAULT


class NameNodeFile:
    def __init__(self, node: NameNode, path: str) -> None:
        self.node = node
        self.path = path
        node.files[path] = b""

    def write(self, data: bytes) -> int:
        self.node.files[self.path] += data
        return len(data)

    def close(self) -> None:
        """All is there already."""


def backend(node: NameNode, monkeypatch: pytest.MonkeyPatch) -> HdfsBackend:
    monkeypatch.setattr("hdfs_native.Client", lambda *_: node)
    patience = Patience(request_seconds=10, tries=3, first_pause_seconds=0)
    return HdfsBackend("namenode:8020", patience)


@pytest.mark.parametrize("lost", ["before", "after"])
def test_a_rename_whose_answer_is_lost_is_still_ours(
    lost: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    node = NameNode(lost)
    hdfs = backend(node, monkeypatch)
    with pytest.raises(TransientError):
        hdfs.put_once("jobs/manifest.json", b"mine", "writer-1")
    assert hdfs.put_once("jobs/manifest.json", b"mine", "writer-1")
    assert node.files == {"/jobs/manifest.json": b"mine"}
    assert not hdfs.put_once("jobs/manifest.json", b"other", "writer-2")
    assert node.files == {"/jobs/manifest.json": b"mine"}


def test_a_rename_that_lost_while_its_answer_did_is_not_ours(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    node = NameNode("before")
    hdfs = backend(node, monkeypatch)
    with pytest.raises(TransientError):
        hdfs.put_once("jobs/manifest.json", b"mine", "writer-1")
    node.files["/jobs/manifest.json"] = b"another's"
    assert not hdfs.put_once("jobs/manifest.json", b"mine", "writer-1")
    assert node.files == {"/jobs/manifest.json": b"another's"}


@pytest.mark.parametrize("lost", [["before"], ["after"], ["before", "after"]])
def test_a_new_file_outlives_lost_answers_to_its_rename(
    lost: list[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    node = NameNode(*lost)
    sink = backend(node, monkeypatch).create("jobs/a.bag")
    sink.write(b"whole")
    sink.commit()
    assert (node.files, node.lose) == ({"/jobs/a.bag": b"whole"}, [])


@pytest.mark.parametrize("lost", ["before", "after"])
def test_a_new_file_replaces_another_also_where_the_answer_is_lost(
    lost: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    node = NameNode(lost)
    node.files["/jobs/a.bag"] = b"earlier"
    sink = backend(node, monkeypatch).create("jobs/a.bag")
    sink.write(b"whole")
    sink.commit()
    assert node.files == {"/jobs/a.bag": b"whole"}


def test_a_rename_that_is_never_answered_ends_and_leaves_nothing(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    node = NameNode(*["before"] * 3)
    sink = backend(node, monkeypatch).create("jobs/a.bag")
    sink.write(b"whole")
    with pytest.raises(OSError, match=r"broke or was refused \(3 tries"):
        sink.commit()
    sink.abandon()
    assert node.files == {}


def test_a_file_that_is_gone_under_both_names_is_no_success(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    node = NameNode("before")
    sink = backend(node, monkeypatch).create("jobs/a.bag")
    rename = node.rename

    def removed(source: str, target: str, overwrite: bool) -> None:
        node.files.clear()
        rename(source, target, overwrite)

    monkeypatch.setattr(node, "rename", removed)
    with pytest.raises(FileNotFoundError, match="vanished"):
        sink.commit()
