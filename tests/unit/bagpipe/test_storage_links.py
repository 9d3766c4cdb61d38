"""Symbolic links in a volume, which a job's user may have written: they never lead out of it."""

import contextlib
import errno
import glob
import os
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

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


@pytest.mark.parametrize("target", ["../outside/token", "../volume-2/token", "/proc/self/environ"])
def test_a_planned_file_that_became_a_link_that_leads_out_is_not_read(
    volume: Path, target: str
) -> None:
    # Its name begins with the volume's.
    (volume.parent / "volume-2").mkdir()
    (volume.parent / "volume-2" / "token").write_text("another's")
    storage = Storage({"r": str(volume)})
    planned = storage.stat("pvc://r/drive.bag")
    (volume / "drive.bag").unlink()
    (volume / "drive.bag").symlink_to(target)
    with pytest.raises(StorageError, match=LEADS_OUT):
        storage.read_planned("pvc://r/drive.bag", planned.size, planned.version)


def test_a_volume_is_read_through_a_link_to_itself(volume: Path) -> None:
    (volume.parent / "mounted").symlink_to("volume")
    (volume / "evil.bag").symlink_to("../outside/token")
    storage = Storage({"r": f"{volume.parent}/mounted/"})
    planned = storage.stat("pvc://r/drive.bag")
    assert storage.read_planned("pvc://r/drive.bag", 11, planned.version) == b"a recording"
    with pytest.raises(StorageError, match=LEADS_OUT):
        storage.read_planned("pvc://r/evil.bag", 1, "")


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


def test_folders_that_link_to_each_other_are_looked_through_once(volume: Path) -> None:
    (volume / "days").mkdir()
    (volume / "days" / "monday.bag").write_text("a recording")
    for name in ("a", "b", "latest"):
        (volume / "days" / name).symlink_to("..")
    (volume / "latest").symlink_to("days")
    found = Storage({"r": str(volume)}).expand("pvc://r/**/*.bag")
    assert found == ["pvc://r/days/monday.bag", "pvc://r/drive.bag"]


def test_a_pattern_goes_into_no_folder_outside_of_the_volume(volume: Path) -> None:
    (volume / "gone").symlink_to("nowhere")
    (volume / "away").symlink_to("/")
    storage = Storage({"r": str(volume)})
    assert storage.expand("pvc://r/*.bag") == ["pvc://r/drive.bag"]
    for pattern in ("**/*.bag", "away/**/*.bag"):
        with pytest.raises(StorageError, match=LEADS_OUT):
            storage.expand(f"pvc://r/{pattern}")


def test_a_folder_elsewhere_in_the_volume_is_looked_through_by_its_link(volume: Path) -> None:
    (volume / "a" / ".store").mkdir(parents=True)
    (volume / "a" / ".store" / "monday.bag").write_text("a recording")
    (volume / "a" / "days").symlink_to(".store")
    storage = Storage({"r": str(volume)})
    assert storage.expand("pvc://r/a/**/*.bag") == ["pvc://r/a/days/monday.bag"]
    assert storage.expand("pvc://r/a/days/**") == ["pvc://r/a/days/monday.bag"]


PATTERNS = (
    "**/*.bag", "**", "*/**/*.bag", "**/day*/**/*.bag", "a/**/b/*", "**/**/*.bag", "a**/x.bag",
    "[[]x]/**/*.bag", "**/.hidden/*.bag", "none/**/*", "**/b/**",
)  # fmt: skip


@pytest.mark.parametrize("pattern", PATTERNS)
def test_without_links_the_patterns_find_what_python_s_find(tmp_path: Path, pattern: str) -> None:
    for name in ("x.bag", "a/x.bag", "a/b/y.bag", "a/day1/b/z.bag", "[x]/b/w.bag", ".hidden/v.bag"):
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_text("a recording")
    # Python's finds a file once for each way to it, where a pattern has ** twice.
    ours = f"{glob.escape(str(tmp_path))}/{pattern}"
    whole = set(glob.glob(ours, recursive=True))  # noqa: PTH207  what ours is compared with
    wanted = sorted(path for path in whole if Path(path).is_file())
    found = Storage({"r": str(tmp_path)}).expand(f"pvc://r/{pattern}")
    assert found == sorted(f"pvc://r/{Path(path).relative_to(tmp_path)}" for path in wanted)


class Listing:
    """os.scandir of one folder fails with this error, before or behind its first entry."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch, name: str, code: int, after: int) -> None:
        self._real, self._name, self._after = os.scandir, name, after
        self._error = OSError(code, os.strerror(code))
        monkeypatch.setattr(os, "scandir", self)

    def __call__(self, path: str) -> Any:
        if Path(path).name != self._name:
            return self._real(path)
        if self._after == 0:
            raise self._error
        return contextlib.nullcontext(self._entries(path))

    def _entries(self, path: str) -> Iterator[os.DirEntry[str]]:
        yield next(self._real(path))
        raise self._error


@pytest.mark.parametrize("pattern", ["*/*.bag", "**/*.bag", "t*/?.bag", "*/**"])
@pytest.mark.parametrize(("code", "after"), [(errno.EIO, 0), (errno.EACCES, 0), (errno.ESTALE, 1)])
def test_a_folder_that_can_t_be_listed_is_no_empty_one(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, pattern: str, code: int, after: int
) -> None:
    """Its recordings would be in no verdict, and nobody would know."""
    for day in ("mon", "tue", "wed"):
        (tmp_path / day).mkdir()
        for name in ("a.bag", "b.bag"):
            (tmp_path / day / name).write_text("a recording")
    storage = Storage({"r": str(tmp_path)})
    assert storage.expand(f"pvc://r/{pattern}")
    Listing(monkeypatch, "tue", code, after)
    with pytest.raises(StorageError, match=os.strerror(code)):
        storage.expand(f"pvc://r/{pattern}")
    if pattern != "t*/?.bag":  # what is not looked into harms nothing
        assert storage.expand("pvc://r/w*/*.bag") == ["pvc://r/wed/a.bag", "pvc://r/wed/b.bag"]


@pytest.mark.parametrize(
    ("pattern", "found"),
    [
        ("*/*.bag", ["mon/a.bag"]), ("**/*.bag", ["mon/a.bag", "mon/r/a.bag"]),
        ("*/a.bag", ["mon/a.bag"]), ("**/a.bag", ["mon/a.bag", "mon/r/a.bag"]),
        ("*", []), ("**", ["mon/a.bag", "mon/r/a.bag"]), ("*/r/*.bag", ["mon/r/a.bag"]),
        ("**/r/*.bag", ["mon/r/a.bag"]), ("*/r/**/*.bag", ["mon/r/a.bag"]),
    ],
)  # fmt: skip
def test_what_the_file_system_keeps_for_itself_has_no_recordings(
    pattern: str, found: list[str]
) -> None:
    """At the root of most volumes, and root's alone: by a process that is not root."""
    asked = (
        "import os, sys; from bagpipe.storage import Storage\n"
        "if os.getuid() == 0: os.setgid(65534); os.setuid(65534)\n"
        "print(*Storage({'r': sys.argv[1]}).expand(f'pvc://r/{sys.argv[2]}'), sep='\\n')"
    )
    # Not below pytest's own folder, which is its user's alone.
    with tempfile.TemporaryDirectory() as volume:
        for name in ("lost+found", "mon/r"):
            Path(volume, name).mkdir(parents=True)
        for name in ("mon/a.bag", "mon/r/a.bag"):
            Path(volume, name).write_text("a recording")
        Path(volume, "lost+found").chmod(0o000)
        Path(volume).chmod(0o755)
        command = [sys.executable, "-c", asked, volume, pattern]
        done = subprocess.run(command, capture_output=True, text=True, timeout=60, check=False)
    assert (done.returncode, done.stderr) == (0, "")
    assert done.stdout.split() == [f"pvc://r/{name}" for name in found]


@pytest.mark.parametrize("pattern", ["*/a.bag", "*/*.bag", "**/*.bag", "m*/**"])
def test_a_link_to_a_recording_that_is_not_there_is_named(tmp_path: Path, pattern: str) -> None:
    """As of a disk that is not mounted: its case is errored, and not left out."""
    for day in ("mon", "mona"):
        (tmp_path / day).mkdir()
        (tmp_path / day / "a.bag").symlink_to(f"nowhere/{day}")
    (tmp_path / "mon" / "a.bag").unlink()
    (tmp_path / "mon" / "a.bag").write_text("a recording")
    found = Storage({"r": str(tmp_path)}).expand(f"pvc://r/{pattern}")
    assert found == ["pvc://r/mon/a.bag", "pvc://r/mona/a.bag"]
