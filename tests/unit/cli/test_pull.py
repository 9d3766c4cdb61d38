"""`bagpipe pull`: what is copied, what is refused, and what stays when it breaks.

The sender is the real program, as a process; pods are tested in integration/control_plane.
"""

import io
import json
import os
import subprocess
import sys
import tarfile
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from bagpipe.cli.cluster.place import Place
from bagpipe.cli.cluster.results_of import ended_job
from bagpipe.cli.delete import remove_results
from bagpipe.cli.places import RefusedError
from bagpipe.cli.pull import _copy, _lacking, named
from bagpipe.cli.pulling import sender
from bagpipe.cli.pulling.entry import MARKER, Entry, PullError, chosen, is_fit, ordered
from bagpipe.cli.pulling.receiving import read_list, received
from bagpipe.cli.pulling.stored import StoredFolder
from bagpipe.cli.pulling.target import Origin, Target, target_at
from bagpipe.storage import Storage
from tests.unit.bagpipe.jobs import make_row
from tests.unit.cli.cluster_objects import ended, running
from tests.unit.report.publishing import publish

ORIGIN = Origin("robots", "lane", "uid-1", "s3://results/lane/uid-1")
PIECE_BYTES = 1000
BLOCK = tarfile.BLOCKSIZE


class Given:
    """Bytes that a pod sent, as an ExecStream gives them."""

    def __init__(self, data: bytes) -> None:
        self._data = io.BytesIO(data)

    def exactly(self, count: int) -> bytes:
        found = self._data.read(count)
        if len(found) < count:
            raise PullError("the connection to the pod broke")
        return found

    def some(self, most: int) -> bytes:
        return self.exactly(1) + self._data.read(most - 1)


@pytest.fixture
def target(tmp_path: Path) -> Iterator[Target]:
    with target_at(tmp_path / "here", ORIGIN) as found:
        yield found


def send(folder: Path, names: list[str] | None) -> subprocess.CompletedProcess[bytes]:
    """What the sender writes about a folder, asked for these names."""
    asked = b"" if names is None else json.dumps(names).encode() + b"\n"
    words = [sys.executable, sender.__file__, str(folder)]
    return subprocess.run(words, input=asked, capture_output=True, timeout=60, check=False)


def head(name: str, size: int, kind: bytes = tarfile.REGTYPE, link: str = "") -> bytes:
    member = tarfile.TarInfo(name)
    member.size, member.type, member.linkname = size, kind, link
    return member.tobuf(tarfile.GNU_FORMAT)


def take(data: bytes, wanted: list[Entry], to: Target) -> None:
    """Copies what a pod sent, as the verb does."""
    for entry, pieces in received(Given(data), wanted, PIECE_BYTES):
        with to.file(entry) as write:
            for piece in pieces:
                write(piece)


def files_of(folder: Path) -> dict[str, bytes]:
    found = {str(p.relative_to(folder)): p.read_bytes() for p in folder.rglob("*") if p.is_file()}
    found.pop(MARKER, None)
    return found


@pytest.mark.parametrize(("written", "name", "namespace"), [
    ("lane", "lane", "asked"),
    ("job/lane", "lane", "asked"),
    ("simjob/lane", "lane", "asked"),
    ("simulationjobs.sim.bagpipe.io/lane", "lane", "asked"),
    ("asked/lane", "lane", "asked"),
])  # fmt: skip
def test_a_job_is_named_as_kubectl_names_it(written: str, name: str, namespace: str) -> None:
    assert named(written, Place(None, "asked")) == (name, Place(None, namespace))
    assert named("robots/lane", Place(None, None)) == ("lane", Place(None, "robots"))


@pytest.mark.parametrize("written", ["other/lane", "a/b/lane", "/lane", "s3://results/lane"])
def test_a_name_that_means_no_job_is_refused(written: str) -> None:
    with pytest.raises(RefusedError):
        named(written, Place(None, "asked"))


def test_a_job_that_runs_or_has_no_results_is_refused() -> None:
    with pytest.raises(RefusedError, match="is Running, 1 of 4 cases are done: its results are"):
        ended_job(running(passed=1))
    with pytest.raises(RefusedError, match="ended without results: DeadlineExceeded"):
        ended_job(ended("", "DeadlineExceeded", results=""))
    assert ended_job(ended()).results == "pvc://results/out/nightly/uid-1"


@pytest.mark.parametrize("name", [
    "", "/etc/passwd", "../up", "cases/../../up", "cases//a", "./a", "a/.", "a\nb", "a\x1b[2J",
    "a\udcff", "x" * 225, "/".join("abcdefghi"), MARKER, "cases/.a.bag.0123.part",
    f"{MARKER}/a",
])  # fmt: skip
def test_a_name_that_leaves_the_folder_or_no_result_has_is_unfit(name: str) -> None:
    assert not is_fit(name)


@pytest.mark.parametrize("name", ["manifest.json", "cases/a b-ü.1.bag", "x" * 224, "..a/b..", ".a"])
def test_other_names_are_fit(name: str) -> None:
    assert is_fit(name)


def test_the_manifest_comes_last_and_patterns_choose() -> None:
    names = ["cases/b.bag", "manifest.json", "cases/a.bag", "report.html"]
    entries = ordered(Entry(name, 1, "") for name in names)
    assert [entry.name for entry in entries] == [
        "report.html", "cases/a.bag", "cases/b.bag", "manifest.json",
    ]  # fmt: skip
    assert chosen(entries, []) == entries
    assert [e.name for e in chosen(entries, ["*/b*", "report.*"])] == ["report.html", "cases/b.bag"]
    with pytest.raises(PullError, match=r"--only x: the results have no such file; they have repo"):
        chosen(entries, ["report.html", "x"])


def test_what_the_sender_sends_arrives(tmp_path: Path, target: Target) -> None:
    folder = tmp_path / "claim"
    (folder / "cases/deep").mkdir(parents=True)
    contents = {
        "manifest.json": b"{}", "cases/a.bag": os.urandom(700_001), "cases/deep/b": b"",
        "cases/c": bytes(BLOCK),
    }  # fmt: skip
    for name, data in contents.items():
        (folder / name).write_bytes(data)
    (folder / "cases/link").symlink_to("/etc/passwd")
    (folder / "up").symlink_to("..")
    os.mkfifo(folder / "pipe")
    (folder / "cases/a\nb").touch()
    (folder / ".c.0123.part").touch()
    listing = Given(send(folder, None).stdout)
    entries, left_out = read_list(listing)
    assert {entry.name: entry.size for entry in entries} == {
        name: len(data) for name, data in contents.items()
    }
    assert sorted(left_out) == ["cases/a\nb", "cases/link", "pipe", "up"]
    wanted = ordered(entries)
    sent = send(folder, [entry.name for entry in wanted])
    assert (sent.returncode, sent.stderr) == (0, b"")
    tar = sent.stdout[len(send(folder, None).stdout) :]
    with tarfile.open(fileobj=io.BytesIO(tar)) as readable:
        assert len(readable.getnames()) == 2 * len(contents)
    take(tar, wanted, target)
    assert files_of(target.folder) == contents
    assert target.missing(wanted) == []


def replace_by_fifo(path: Path) -> None:
    path.unlink()
    os.mkfifo(path)


@pytest.mark.parametrize(("change", "words"), [
    (lambda path: path.write_bytes(b"other"), "'a' was changed while it was copied"),
    (lambda path: (path.unlink(), path.symlink_to("/etc/passwd")), "a can't be read"),
    (replace_by_fifo, "'a' was changed while it was copied"),
    (lambda path: path.unlink(), "a can't be read: No such file"),
], ids=["other", "link", "fifo", "gone"])  # fmt: skip
def test_a_file_that_changes_meanwhile_ends_the_sender(
    tmp_path: Path, change: Callable[[Path], object], words: str
) -> None:
    path = tmp_path / "a"
    path.write_bytes(b"1234")
    program = subprocess.Popen(
        [sys.executable, sender.__file__, str(tmp_path)],
        stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.PIPE,
    )  # fmt: skip
    assert program.stdin
    assert program.stdout
    program.stdout.read(int(program.stdout.readline()))
    change(path)
    _, stderr = program.communicate(b'["a"]\n', timeout=60)
    assert program.returncode == 1
    assert words in stderr.decode()


def test_the_sender_says_in_a_sentence_what_it_can_t_read(tmp_path: Path) -> None:
    done = send(tmp_path / "gone", [])
    assert (done.returncode, done.stderr) == (1, b"there is no such folder on the claim\n")


WANTED = [Entry("cases/a.bag", 3, "1")]
DIGEST = b"ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad"  # of abc
WHOLE = b"".join([
    head("0", 3), b"abc", bytes(BLOCK - 3), head("0.sha256", 64), DIGEST, bytes(BLOCK - 64),
    bytes(2 * BLOCK),
])  # fmt: skip


def test_a_whole_tar_is_taken(target: Target) -> None:
    take(WHOLE, WANTED, target)
    assert files_of(target.folder) == {"cases/a.bag": b"abc"}


@pytest.mark.parametrize("first", [
    head("../../up", 3),
    head("/etc/passwd", 3),
    head("1", 3),
    head("0", 4),
    head("0", 1 << 40),
    head("0", 3, tarfile.SYMTYPE, "/etc/passwd"),
    head("0", 3, tarfile.LNKTYPE, "/etc/passwd"),
    head("0", 3, tarfile.CHRTYPE),
    head("0", 3, tarfile.FIFOTYPE),
    head("0", 3, tarfile.DIRTYPE),
    head("0", 1 << 40, tarfile.XHDTYPE),
    head("0", 1 << 40, tarfile.GNUTYPE_LONGNAME),
    bytes(BLOCK),
    b"\xff" * BLOCK,
], ids=lambda block: repr(block[:10]))  # fmt: skip
def test_a_member_that_was_not_asked_for_is_refused(first: bytes, target: Target) -> None:
    with pytest.raises(PullError, match="the pod sent"):
        take(first + WHOLE[BLOCK:], WANTED, target)
    assert files_of(target.folder) == {}


@pytest.mark.parametrize("end", [0, BLOCK - 1, BLOCK, BLOCK + 2, 2 * BLOCK, 3 * BLOCK + 63])
def test_a_stream_that_ends_early_leaves_no_file(end: int, target: Target) -> None:
    with pytest.raises(PullError, match="broke"):
        take(WHOLE[:end], WANTED, target)
    assert files_of(target.folder) == {}


@pytest.mark.parametrize("at", [BLOCK, BLOCK + 2, 3 * BLOCK, 3 * BLOCK + 63])
def test_a_byte_that_is_another_one_leaves_no_file(at: int, target: Target) -> None:
    spoiled = bytearray(WHOLE)
    spoiled[at] ^= 1
    with pytest.raises(PullError, match="came with other bytes"):
        take(bytes(spoiled), WANTED, target)
    assert files_of(target.folder) == {}


def test_what_follows_the_tar_is_refused(target: Target) -> None:
    with pytest.raises(PullError, match="more than was asked for"):
        take(WHOLE[: -2 * BLOCK] + head("1", 3) + bytes(BLOCK), WANTED, target)


def a_list(text: bytes) -> Given:
    return Given(b"%d\n" % len(text) + text)


@pytest.mark.parametrize("text", [
    b"abc\n", b"-5\n", b"9" * 30, b"99999999999\n", b"2\n[]", b"2\n{x", b"9\n{\"a\": 12}",
    b"200001\n" + b"[" * 200001,
])  # fmt: skip
def test_a_list_that_is_none_is_refused(text: bytes) -> None:
    with pytest.raises(PullError):
        read_list(Given(text))


@pytest.mark.parametrize(("size", "fits"), [
    (b"0", True), (b"9223372036854775807", True), (b"9223372036854775808", False), (b"-1", False),
    (b"1e999", False), (b"NaN", False), (b"1" + b"0" * 4000, False), (b"[1]", False),
])  # fmt: skip
def test_a_size_that_no_file_has_is_refused(size: bytes, *, fits: bool) -> None:
    given = a_list(b'{"files": [["a", %b, "x"]], "others": []}' % size)
    if fits:
        assert read_list(given) == ([Entry("a", int(size), "x")], [])
        return
    with pytest.raises(PullError, match="list of files"):
        read_list(given)


def test_a_name_that_is_listed_twice_is_refused() -> None:
    with pytest.raises(PullError, match="names twice"):
        read_list(a_list(b'{"files": [["a", 1, "x"], ["a", 2, "y"]], "others": []}'))


@pytest.mark.parametrize("manifest", [
    '{"cases": ["x"], "counts": {}}', '{"cases": [{"recorded": [1]}], "counts": {}}',
    '{"cases": [], "counts": "ab"}', '{"cases": {"a": 1}, "counts": {}}', "[1]", "{}",
    '{"counts": [[1]]}', "[" * 100_000,
])  # fmt: skip
def test_a_manifest_that_is_none_is_named(tmp_path: Path, manifest: str) -> None:
    (tmp_path / "manifest.json").write_text(manifest)
    with pytest.raises(PullError, match=r"manifest\.json is no manifest of results"):
        _lacking(tmp_path, {"manifest.json"})


def test_results_on_storage_have_the_time_that_is_allowed(tmp_path: Path, target: Target) -> None:
    folder = publish(tmp_path, [make_row("a-0")])
    source = StoredFolder(f"file://{folder}", Storage({}), until=time.monotonic() - 1)
    with pytest.raises(PullError, match="the time that --timeout allows is over"):
        source.listed()
    entries, _ = StoredFolder(f"file://{folder}", Storage({})).listed()
    with pytest.raises(PullError, match="the time that --timeout allows is over"):
        take_stored(source, entries, target)
    assert files_of(target.folder) == {}


def take_stored(source: StoredFolder, entries: list[Entry], to: Target) -> None:
    for entry, pieces in source.sent(entries):
        with to.file(entry) as write:
            for piece in pieces:
                write(piece)


def test_results_on_storage_are_copied_and_those_that_lack_are_named(
    tmp_path: Path, target: Target
) -> None:
    rows = [make_row(f"a-{n}") | {"recorded": f"cases/a-{n}.1.bag"} for n in range(2)]
    folder = publish(tmp_path, rows)
    (folder / "cases").mkdir(exist_ok=True)
    (folder / "cases/a-0.1.bag").write_bytes(os.urandom(2_000_001))
    source = StoredFolder(f"file://{folder}", Storage({}))
    pulled = _copy(source, target, [], shown=True)
    assert files_of(target.folder) == files_of(folder)
    assert (pulled.left_out, pulled.missing) == ([], ["cases/a-1.1.bag"])
    again = _copy(source, target, [], shown=False)
    assert (again.files, again.here) == (0, pulled.files)
    assert _lacking(target.folder, set()) == []
    remove_results(f"file://{target.folder}", Storage({}))
    assert not target.folder.exists()
    with pytest.raises(PullError, match="has no files, or is not there"):
        StoredFolder(f"file://{folder}/gone", Storage({})).listed()


def test_a_stored_file_that_changes_meanwhile_is_refused(tmp_path: Path, target: Target) -> None:
    (tmp_path / "from").mkdir()
    file = tmp_path / "from/a"
    file.write_bytes(b"1234")
    source = StoredFolder(f"file://{tmp_path}/from", Storage({}))
    entries, _ = source.listed()
    file.write_bytes(b"12345")
    with pytest.raises(PullError, match="is no longer the file"):
        take_stored(source, entries, target)
    assert files_of(target.folder) == {}
