"""put_once on HDFS where answers get lost: the NameNode's rename is what decides."""

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

    def rename(self, source: str, target: str, _overwrite: bool) -> None:
        lost = self.lose.pop(0) if self.lose else ""
        if lost == "before":
            raise RUNTIME_FAULT
        if target in self.files:
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
    return HdfsBackend("namenode:8020", Patience(request_seconds=10))


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
