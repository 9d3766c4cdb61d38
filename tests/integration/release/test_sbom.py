"""What syft lists of an image and of the crates, and that it says nothing of this machine."""

from __future__ import annotations

import json
import tomllib
from pathlib import Path

import pytest
from embedded import oci

from release import ReleaseError, sbom

# syft takes minutes to build, of which everybody else has nothing.
pytestmark = pytest.mark.slow

ROOT = Path(__file__).parents[3]
STATUS = """\
Package: tree
Status: install ok installed
Version: 2.1.0-1
Architecture: amd64
Maintainer: Somebody <somebody@debian.example>
Description: shows folders

"""


def components(listed: Path) -> set[tuple[str, str]]:
    """Name and version of each component of a list."""
    found = json.loads(listed.read_text())["components"]
    return {(each["name"], each.get("version", "")) for each in found}


def image(folder: Path) -> Path:
    """An archive of an image with Debian's list of one package."""
    folder.mkdir()
    (folder / "status").write_text(STATUS)
    inside = "/var/lib/dpkg/status"
    oci.write_single_binary(folder / "image.tar", "a/b:1", folder / "status", inside)
    return folder / "image.tar"


def test_the_packages_of_an_image_are_listed(tmp_path: Path) -> None:
    first = sbom.of_image(image(tmp_path / "a"), "agent", "1.2.3", "arm64", tmp_path / "sbom")
    assert components(first) == {("tree", "2.1.0-1")}
    text = first.read_text()
    assert json.loads(text)["metadata"]["component"]["name"] == "bagpipe/agent"
    assert str(tmp_path) not in text
    again = sbom.of_image(image(tmp_path / "b"), "agent", "1.2.3", "arm64", tmp_path / "other")
    assert again.read_text() == text


def test_every_crate_of_the_lock_is_listed(tmp_path: Path) -> None:
    lock = tomllib.loads((ROOT / "images/agent/Cargo.lock").read_text())["package"]
    outside = {(each["name"], each["version"]) for each in lock if "source" in each}
    assert len(outside) > 50
    assert outside <= components(sbom.of_crates("1.2.3", tmp_path))


def test_what_can_t_be_listed_is_named(tmp_path: Path) -> None:
    with pytest.raises(
        ReleaseError, match=f"syft could not list what is in oci-archive:{tmp_path}/"
    ):
        sbom.of_image(tmp_path / "none.tar", "agent", "1.2.3", "arm64", tmp_path)
