"""Parts of a release: its notes, its checksums, its images' archives, and what is refused."""

from __future__ import annotations

import io
import subprocess
import tarfile
from pathlib import Path

import pytest
from embedded import oci

from release import ReleaseError, archives, changelog, make, sums, version

ROOT = Path(__file__).parents[3]
CHANGES = """\
# Changes

## 1.10.0 (not released yet)

- Later.

## 1.1.0

### For all

- It reads [files](docs/files.md), and
  [others](https://files.example/).
- `b` is there.

## 1.0.0

"""


@pytest.fixture
def text(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "CHANGELOG.md").write_text(CHANGES)
    monkeypatch.setattr(changelog, "ROOT", tmp_path)


@pytest.mark.usefixtures("text")
def test_the_notes_are_the_version_s_section_without_links_into_the_checkout() -> None:
    assert changelog.notes("1.1.0") == (
        "# Bagpipe 1.1.0\n\n### For all\n\n- It reads files, and\n"
        "  [others](https://files.example/).\n- `b` is there.\n"
    )
    assert changelog.changes("1.1.0") == [
        "It reads files, and [others](https://files.example/).",
        "`b` is there.",
    ]
    assert changelog.changes("1.10.0") == ["Later."]


@pytest.mark.usefixtures("text")
@pytest.mark.parametrize("number", ["1.1", "1.0.0", "2.0.0", "1.1.00", ".*"])
def test_a_version_of_which_nothing_is_written_is_refused(number: str) -> None:
    with pytest.raises(ReleaseError, match=r"^CHANGELOG\.md says nothing of "):
        changelog.notes(number)


def test_this_checkout_has_notes() -> None:
    assert changelog.changes(version.version())


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A folder of two files with their checksums."""
    found = tmp_path / "dist"
    (found / "images").mkdir(parents=True)
    (found / "NOTES.md").write_text("notes\n")
    (found / "images/agent.tar").write_bytes(b"agent")
    sums.write(found)
    return found


def test_sha256sum_reads_the_checksums(folder: Path) -> None:
    sums.check(folder)
    command = ["sha256sum", "--check", "--strict", sums.SUMS]
    answer = subprocess.run(
        command, cwd=folder, capture_output=True, text=True, timeout=60, check=True
    )
    assert answer.stdout == "NOTES.md: OK\nimages/agent.tar: OK\n"


def test_a_release_that_was_changed_is_named_by_its_files(folder: Path) -> None:
    (folder / "NOTES.md").write_text("other\n")
    (folder / "images/agent.tar").rename(folder / "images/new.tar")
    with pytest.raises(ReleaseError) as caught:
        sums.check(folder)
    assert str(caught.value) == (
        f"{folder} is not as it was made: images/agent.tar is missing; images/new.tar is in no line"
        " of SHA256SUMS; NOTES.md was changed."
    )


def test_a_folder_that_is_no_release_is_refused(tmp_path: Path) -> None:
    with pytest.raises(ReleaseError, match="is no release, as it has no SHA256SUMS"):
        sums.check(tmp_path)


def key_in(folder: Path, name: str) -> Path:
    key = folder / name
    command = ["ssh-keygen", "-q", "-t", "ed25519", "-N", "", "-C", name, "-f", str(key)]
    subprocess.run(command, check=True, timeout=60)
    return key


def verified(folder: Path, key: Path) -> bool:
    """Whether OpenSSH takes the signature for that of a key's owner."""
    signers = key.with_suffix(".signers")
    signers.write_text(f"releases@robots.example {key.with_suffix('.pub').read_text()}")
    command = ["ssh-keygen", "-Y", "verify", "-f", str(signers), "-I", "releases@robots.example"]
    command += ["-n", sums.NAMESPACE, "-s", str(folder / sums.SIGNATURE)]
    with (folder / sums.SUMS).open("rb") as signed:
        done = subprocess.run(command, stdin=signed, capture_output=True, timeout=60, check=False)
    return done.returncode == 0


def test_the_signature_is_of_the_checksums_and_the_key(folder: Path, tmp_path: Path) -> None:
    own, other = key_in(tmp_path, "own"), key_in(tmp_path, "other")
    sums.sign(folder, own)
    sums.check(folder)  # the signature is none of the files
    assert verified(folder, own)
    assert not verified(folder, other)
    (folder / sums.SUMS).write_text((folder / sums.SUMS).read_text().replace("0", "1"))
    assert not verified(folder, own)


def test_a_key_that_can_t_sign_is_named(folder: Path, tmp_path: Path) -> None:
    with pytest.raises(ReleaseError, match=f"ssh-keygen could not sign with {tmp_path}/none: "):
        sums.sign(folder, tmp_path / "none")


@pytest.fixture
def archive(tmp_path: Path) -> Path:
    """An image of one small program."""
    (tmp_path / "program").write_bytes(b"program")
    oci.write_single_binary(tmp_path / "image.tar", "a/b:1", tmp_path / "program", "/program")
    return tmp_path / "image.tar"


def test_an_archive_names_its_image(archive: Path) -> None:
    found = archives.inspect(archive)
    assert (found.name, found.platforms) == ("a/b:1", "linux/amd64")
    assert oci.names_and_digests(archive) == {"a/b:1": found.digest}


def test_a_blob_of_another_content_is_named(archive: Path) -> None:
    data = archive.read_bytes()
    at = data.index(b"program", data.index(b"program") + 7)
    archive.write_bytes(data[:at] + b"Program" + data[at + 7 :])
    with pytest.raises(
        ReleaseError, match=r"image\.tar: the blob sha256:\w{64} has the content of"
    ):
        archives.inspect(archive)


def test_an_archive_without_one_of_its_layers_is_refused(archive: Path, tmp_path: Path) -> None:
    with tarfile.open(archive) as whole, tarfile.open(tmp_path / "cut.tar", "w") as cut:
        largest = max(whole, key=lambda member: member.size)
        for member in whole.getmembers():
            if member is not largest:
                cut.addfile(member, whole.extractfile(member))
    with pytest.raises(ReleaseError, match=f"lacks sha256:{Path(largest.name).name}, which its"):
        archives.inspect(tmp_path / "cut.tar")


def tar_of(path: Path, name: str, content: bytes) -> Path:
    with tarfile.open(path, "w") as tar:
        info = tarfile.TarInfo(name)
        info.size = len(content)
        tar.addfile(info, io.BytesIO(content))
    return path


@pytest.mark.parametrize(
    "content", [b"{}", b"[]", b'{"manifests": [3]}', b"\xff", b" " * (5 << 20)]
)
def test_what_is_no_archive_is_refused(tmp_path: Path, content: bytes) -> None:
    with pytest.raises(ReleaseError, match="is no OCI image archive: "):
        archives.inspect(tar_of(tmp_path / "a.tar", "index.json", content))


def test_another_version_than_the_checkout_s_is_refused() -> None:
    with pytest.raises(ReleaseError) as caught:
        make.asked_for("9.9.9")
    assert str(caught.value).startswith(
        f"This checkout is of {version.version()}, and 9.9.9 was asked for: run `make version"
    )


def test_a_folder_that_holds_anything_else_is_not_replaced(tmp_path: Path) -> None:
    (tmp_path / "thesis").mkdir()
    (tmp_path / "thesis/chapter").write_text("words")
    with pytest.raises(ReleaseError, match="is there and no release: name another one"):
        make.replace(tmp_path / "thesis", tmp_path / "made")
    assert (tmp_path / "thesis/chapter").read_text() == "words"
