"""The folder on this machine that `bagpipe pull` writes into, and what is in it already."""

import json
from collections.abc import Iterator
from pathlib import Path

import pytest

from bagpipe.cli.pulling.entry import MARKER, Entry, PullError
from bagpipe.cli.pulling.target import Origin, Target, target_at

ORIGIN = Origin("robots", "lane", "uid-1", "s3://results/lane/uid-1")


@pytest.fixture
def target(tmp_path: Path) -> Iterator[Target]:
    with target_at(tmp_path / "here", ORIGIN) as found:
        yield found


def files_of(folder: Path) -> dict[str, bytes]:
    found = {str(p.relative_to(folder)): p.read_bytes() for p in folder.rglob("*") if p.is_file()}
    found.pop(MARKER, None)
    return found


def test_others_folders_are_not_written_to(tmp_path: Path) -> None:
    theirs = tmp_path / "theirs"
    theirs.mkdir()
    (theirs / "notes.txt").write_text("mine")
    file = tmp_path / "file"
    file.touch()
    for folder, words in ((theirs, "no pull has made"), (file, "is no folder")):
        with pytest.raises(PullError, match=words), target_at(folder, ORIGIN):
            pass
    assert files_of(theirs) == {"notes.txt": b"mine"}


def test_a_folder_of_another_job_s_results_is_refused(tmp_path: Path, target: Target) -> None:
    other = Origin("robots", "lane", "uid-2", "s3://results/lane/uid-2")
    with pytest.raises(PullError, match="another pull is writing"), target_at(target.folder, other):
        pass
    for origin in (other, ORIGIN):
        folder = tmp_path / "again"
        with target_at(folder, ORIGIN):
            pass
        if origin is ORIGIN:
            with target_at(folder, origin):
                return
        words = r"holds results of job robots/lane \(s3://results/lane/uid-1\)"
        with pytest.raises(PullError, match=words), target_at(folder, origin):
            pass


def test_files_that_no_pull_made_are_never_replaced(tmp_path: Path) -> None:
    entry, folder = Entry("report.html", 3, "1"), tmp_path / "here"
    with target_at(folder, ORIGIN) as target:
        (folder / "report.html").write_text("abc")
        with pytest.raises(PullError, match="no pull has made it: move it away"):
            target.missing([entry])
        # Also where it came while this one was copied.
        with pytest.raises(PullError, match="is not replaced"), target.file(entry) as write:
            write(b"new")
    assert files_of(folder) == {"report.html": b"abc"}


def test_a_pulled_file_that_was_changed_is_refused(tmp_path: Path) -> None:
    entry, folder = Entry("report.html", 3, "1"), tmp_path / "here"
    with target_at(folder, ORIGIN) as target, target.file(entry) as write:
        write(b"abc")
    with target_at(folder, ORIGIN) as target:
        assert target.missing([entry]) == []
        with pytest.raises(PullError, match="is another one by now"):
            target.missing([Entry("report.html", 3, "2")])
        (folder / "report.html").write_text("mine")
        with pytest.raises(PullError, match="was changed since it was pulled"):
            target.missing([entry])


def test_a_link_that_leads_out_of_the_folder_is_not_followed(tmp_path: Path) -> None:
    folder, outside = tmp_path / "here", tmp_path / "outside"
    outside.mkdir()
    with target_at(folder, ORIGIN) as target:
        (folder / "cases").symlink_to(outside)
        with pytest.raises(PullError, match="leads out of"):
            target.missing([Entry("cases/a.bag", 3, "1")])


def test_what_a_killed_pull_left_is_swept_and_made_whole(tmp_path: Path) -> None:
    folder = tmp_path / "here"
    entries = [Entry("cases/a.bag", 3, "1"), Entry("cases/b.bag", 3, "1")]
    with target_at(folder, ORIGIN) as target, target.file(entries[0]) as write:
        write(b"abc")
    (folder / "cases" / f".b.bag.{'0a' * 12}.part").write_bytes(b"ab")
    (folder / "cases/.mine.part").touch()
    with (folder / MARKER).open("ab") as marker:
        # It was to come, and the line after that is torn.
        marker.write(json.dumps({"name": "cases/b.bag", "size": 3, "version": "1"}).encode())
        marker.write(b'\n{"name": "ca')
    for _ in range(2):
        with target_at(folder, ORIGIN) as target:
            assert target.missing(entries) == entries[1:]
    assert set(files_of(folder)) == {"cases/a.bag", "cases/.mine.part"}
    with target_at(folder, ORIGIN) as target, target.file(entries[1]) as write:
        write(b"abc")
    with target_at(folder, ORIGIN) as target:
        assert target.missing(entries) == []


def test_a_disk_without_room_is_refused_before_anything_is_copied(target: Target) -> None:
    with pytest.raises(PullError, match=r"has room for .*, and 1024 TiB are to come"):
        target.check_room([Entry("a", 1 << 50, "1")])
