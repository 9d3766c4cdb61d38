"""Storage on a real folder: globs, ranges, whole-or-nothing writes."""

import os
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest

from bagpipe.storage import Storage, StorageError


@pytest.fixture
def storage(tmp_path: Path) -> Storage:
    (tmp_path / "a").mkdir()
    for name in ("one.bag", "two.bag", "note.txt"):
        (tmp_path / "a" / name).write_bytes(bytes(range(100)))
    return Storage({"claim": str(tmp_path)})


def test_a_pattern_names_files_in_the_users_own_words(storage: Storage, tmp_path: Path) -> None:
    expected = ["pvc://claim/a/one.bag", "pvc://claim/a/two.bag"]
    assert storage.expand("pvc://claim/a/*.bag") == expected
    assert storage.expand(f"file://{tmp_path}/a/one*") == [f"file://{tmp_path}/a/one.bag"]
    assert storage.expand("pvc://claim/a/none.bag") == []
    assert storage.expand("pvc://claim/b/*.bag") == []


def test_pieces_are_the_ranges_in_order(storage: Storage) -> None:
    pieces = list(storage.pieces("pvc://claim/a/one.bag", [(90, 5), (10, 25)], 10))
    assert [len(piece) for piece in pieces] == [5, 10, 10, 5]
    assert b"".join(pieces) == bytes(range(90, 95)) + bytes(range(10, 35))


def test_a_file_that_shrank_is_named_with_its_byte(storage: Storage) -> None:
    with pytest.raises(StorageError, match="ends at byte 100, but its index names bytes up to 120"):
        list(storage.pieces("pvc://claim/a/one.bag", [(90, 30)], 8))


def test_a_file_appears_only_when_it_is_whole(storage: Storage, tmp_path: Path) -> None:
    with pytest.raises(RuntimeError), storage.create("pvc://claim/out/x/result") as file:
        file.write(b"half")
        raise RuntimeError("interrupted")
    assert storage.names("pvc://claim/out/x") == []
    with storage.create("pvc://claim/out/x/result") as file:
        file.write(b"whole")
    assert (tmp_path / "out/x/result").read_bytes() == b"whole"
    assert storage.names("pvc://claim/out/x") == ["result"]


def test_a_file_is_on_the_volume_before_it_has_its_name(
    storage: Storage, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    calls: list[str] = []
    fsync, replace = os.fsync, Path.replace

    def noted_fsync(descriptor: int) -> None:
        calls.append(f"fsync of {os.fstat(descriptor).st_size} bytes")
        fsync(descriptor)

    def noted_replace(path: Path, target: Path) -> Path:
        calls.append(f"rename to {target.name}")
        return replace(path, target)

    monkeypatch.setattr(os, "fsync", noted_fsync)
    monkeypatch.setattr(Path, "replace", noted_replace)
    with storage.create("pvc://claim/out/result") as file:
        file.write(b"whole")
    assert calls == ["fsync of 5 bytes", "rename to result"]
    assert (tmp_path / "out/result").read_bytes() == b"whole"


def test_an_unmounted_claim_and_a_missing_file_are_sentences(storage: Storage) -> None:
    with pytest.raises(StorageError, match="the claim other is not mounted"):
        storage.size("pvc://other/x")
    with pytest.raises(StorageError, match=r"pvc://claim/none can't be read: No such file"):
        storage.size("pvc://claim/none")


def test_removing_twice_is_no_error(storage: Storage) -> None:
    storage.remove("pvc://claim/a/note.txt")
    storage.remove("pvc://claim/a/note.txt")
    assert storage.names("pvc://claim/a") == ["one.bag", "two.bag"]


def test_a_whole_file_is_read_up_to_a_limit(storage: Storage) -> None:
    assert storage.read_all("pvc://claim/a/one.bag", 100) == bytes(range(100))
    with pytest.raises(StorageError, match="has 100 bytes where at most 99 are expected"):
        storage.read_all("pvc://claim/a/one.bag", 99)


def test_existing_means_a_file_and_not_a_folder(storage: Storage) -> None:
    assert storage.exists("pvc://claim/a/one.bag")
    assert not storage.exists("pvc://claim/a")
    assert not storage.exists("pvc://claim/a/none.bag")


def test_one_of_many_writers_puts_a_file_and_leaves_nothing_else(storage: Storage) -> None:
    uri = "pvc://claim/out/manifest.json"
    with ThreadPoolExecutor(8) as writers:
        won = list(writers.map(lambda n: storage.put_once(uri, bytes([n]) * 100_000), range(8)))
    assert won.count(True) == 1
    assert storage.read_all(uri, 100_000) == bytes([won.index(True)]) * 100_000
    assert storage.names("pvc://claim/out") == ["manifest.json"]
    assert not storage.put_once(uri, b"later")


def test_a_bag_that_changed_since_it_was_planned_is_refused(
    storage: Storage, tmp_path: Path
) -> None:
    version = storage.stat("pvc://claim/a/one.bag").version
    assert b"".join(storage.pieces("pvc://claim/a/one.bag", [(0, 9)], 9, version)) == bytes(
        range(9)
    )
    (tmp_path / "a/one.bag").write_bytes(bytes(101))
    with pytest.raises(StorageError, match=r"a/one\.bag is no longer the file that was planned"):
        list(storage.pieces("pvc://claim/a/one.bag", [(0, 9)], 9, version))
