"""Symbolic links in a volume, which a job's user may have written: they never lead out of it."""

from collections.abc import Callable
from pathlib import Path

import pytest

from bagpipe.storage import Storage, StorageError

LEADS_OUT = "a symbolic link leads out of the volume"


@pytest.fixture
def volume(tmp_path: Path) -> Path:
    (tmp_path / "outside").mkdir()
    (tmp_path / "outside" / "token").write_text("the driver's own")
    folder = tmp_path / "volume"
    folder.mkdir()
    (folder / "drive.bag").write_text("a recording")
    return folder


@pytest.mark.parametrize("target", ["../outside/token", "/proc/self/environ"])
def test_a_file_is_not_read_through_a_link_that_leads_out(volume: Path, target: str) -> None:
    (volume / "evil.bag").symlink_to(target)
    storage = Storage({"recordings": str(volume)})
    for ask in (storage.open, storage.exists, lambda uri: storage.read(uri, 0, 1)):
        with pytest.raises(StorageError, match=LEADS_OUT):
            ask("pvc://recordings/evil.bag")


def test_a_link_that_stays_in_the_volume_is_followed(volume: Path) -> None:
    (volume / "latest.bag").symlink_to("drive.bag")
    assert Storage({"r": str(volume)}).read("pvc://r/latest.bag", 0, 20) == b"a recording"


def test_a_file_that_became_a_link_after_it_was_looked_at_is_not_read(volume: Path) -> None:
    storage = Storage({"r": str(volume)})
    opened = storage.open("pvc://r/drive.bag")
    (volume / "drive.bag").unlink()
    (volume / "drive.bag").symlink_to("../outside/token")
    with pytest.raises(StorageError, match=LEADS_OUT):
        opened.read(0, 5)


WRITES: dict[str, Callable[[Storage, str], object]] = {
    "create": lambda storage, uri: storage.create(uri).__enter__(),
    "put_once": lambda storage, uri: storage.put_once(uri, b"x"),
    "remove": lambda storage, uri: storage.remove(uri),
    "names": lambda storage, uri: storage.names(uri.rpartition("/")[0]),
}


@pytest.mark.parametrize("how", WRITES)
def test_nothing_is_written_or_removed_through_a_folder_that_leads_out(
    volume: Path, how: str
) -> None:
    (volume / "results").symlink_to("../outside")
    with pytest.raises(StorageError, match=LEADS_OUT):
        WRITES[how](Storage({"r": str(volume)}), "pvc://r/results/token")
    assert [path.name for path in (volume.parent / "outside").iterdir()] == ["token"]


@pytest.mark.parametrize("uri", ["file:///proc/self/environ", "file:///proc/1/environ"])
def test_the_process_s_own_environment_is_no_file_of_a_job(uri: str) -> None:
    with pytest.raises(StorageError, match=LEADS_OUT):
        Storage({}).open(uri)
