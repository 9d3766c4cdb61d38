"""kubectl's plugin as krew wants it: an archive, and a manifest that knows its hash."""

from __future__ import annotations

import hashlib
import platform
import re
import tarfile
from pathlib import Path

import plugin
import pytest
import yaml
from context import VERSION

FILES = {
    "LICENSE": 0o644,
    f"bagpipe-{VERSION}-py3-none-any.whl": 0o644,
    f"bagpipe_bag-{VERSION}-cp311-abi3-manylinux_2_34_{platform.machine()}.whl": 0o644,
    "kubectl-bagpipe": 0o755,
    "kubectl_complete-bagpipe": 0o755,
    "requirements.txt": 0o644,
}


@pytest.fixture(scope="module")
def packed(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    return plugin.pack(tmp_path_factory.mktemp("plugin"))


def test_the_archive_has_plain_files_with_their_modes(packed: tuple[Path, Path]) -> None:
    with tarfile.open(packed[0]) as tar:
        assert all(entry.isreg() for entry in tar)  # krew unpacks no links
        assert {entry.name: entry.mode for entry in tar} == FILES
        assert {(entry.uid, entry.uname, entry.mtime) for entry in tar} == {(0, "", plugin.EPOCH)}


def test_the_same_sources_give_the_same_bytes(packed: tuple[Path, Path], tmp_path: Path) -> None:
    again = plugin.pack(tmp_path)
    assert [p.read_bytes() for p in again] == [p.read_bytes() for p in packed]


def test_the_manifest_is_krew_s(packed: tuple[Path, Path]) -> None:
    archive, manifest = packed
    plugin = yaml.safe_load(manifest.read_text())
    assert (plugin["kind"], plugin["metadata"]["name"]) == ("Plugin", "bagpipe")
    assert manifest.stem == plugin["metadata"]["name"]  # krew asks for that
    assert re.fullmatch(r"v\d+\.\d+\.\d+", plugin["spec"]["version"])
    (platform,) = plugin["spec"]["platforms"]
    assert platform["sha256"] == hashlib.sha256(archive.read_bytes()).hexdigest()
    assert platform["bin"] == "kubectl-bagpipe"
    assert platform["uri"] == f"https://downloads.example/{archive.name}"


def test_its_address_can_be_given(tmp_path: Path) -> None:
    _, manifest = plugin.pack(tmp_path, "https://plugins.example/{file}")
    (platform,) = yaml.safe_load(manifest.read_text())["spec"]["platforms"]
    assert platform["uri"] == f"https://plugins.example/kubectl-bagpipe-v{VERSION}.tar.gz"


def test_what_it_needs_is_pinned_by_hash_and_from_nowhere_in_particular(
    packed: tuple[Path, Path],
) -> None:
    with tarfile.open(packed[0]) as tar:
        file = tar.extractfile("requirements.txt")
        assert file is not None
        lines = file.read().decode().splitlines()
    needs = [line for line in lines if line and not line.startswith((" ", "#"))]
    assert all(re.match(r"[a-z0-9._-]+(\[[a-z,]+\])?==\S+", line, re.IGNORECASE) for line in needs)
    hashed = "\n".join(lines).count("--hash=sha256:")
    assert hashed >= len(needs)
    assert not [line for line in lines if "://" in line or line.startswith(("-i", "--index"))]
    names = {line.partition("==")[0] for line in needs}
    assert {"click", "kubernetes", "rich", "obstore"} <= names
    assert not names & {"pyspark", "py4j", "pyarrow", "bagpipe"}
