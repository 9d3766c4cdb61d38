"""OCI image archives: their blobs checked, and laid out in a folder for whoever pushes them."""

from __future__ import annotations

import hashlib
import json
import tarfile
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path, PurePosixPath
from typing import Any

from release import ReleaseError

# A manifest and an index are texts of a few kilobytes; what is larger is neither.
DESCRIPTION_BYTES = 4 << 20
_STEP = 1 << 20
_NAME = "org.opencontainers.image.ref.name"


@dataclass(frozen=True)
class Archive:
    """An archive with one image: its name and tag, its manifest's digest, and its platform."""

    name: str
    digest: str
    platform: str


def inspect(path: Path) -> Archive:
    """Check every blob of an archive against its digest. Raises ReleaseError.

    The whole file is read once, a MiB at a time.
    """
    try:
        with tarfile.open(path) as tar:
            return _inspected(path, tar)
    except (OSError, tarfile.TarError, ValueError, KeyError, TypeError) as error:
        raise ReleaseError(f"{path} is no OCI image archive: {error}") from error


def unpack(path: Path, folder: Path) -> Path:
    """Lay the archive out as a folder, which is returned; it was inspected before."""
    with tarfile.open(path) as tar:
        tar.extractall(folder, filter="data")
    return folder


def _inspected(path: Path, tar: tarfile.TarFile) -> Archive:
    blobs = {}
    for member, name in _blobs(tar):
        found = _digest(tar, member)
        if found != name:
            raise ReleaseError(f"{path}: the blob {name} has the content of {found}.")
        blobs[name] = member
    described = _read(tar, tar.getmember("index.json"))["manifests"]
    if len(described) != 1:
        raise ReleaseError(f"{path} holds {len(described)} images, and one was expected.")
    digest = str(described[0]["digest"])
    manifest = _read(tar, blobs[digest])
    for each in (manifest["config"], *manifest["layers"]):
        if each["digest"] not in blobs:
            raise ReleaseError(f"{path} lacks {each['digest']}, which its manifest names.")
    name = str(described[0].get("annotations", {}).get(_NAME, ""))
    config = _read(tar, blobs[manifest["config"]["digest"]])
    return Archive(name, digest, f"{config['os']}/{config['architecture']}")


def _blobs(tar: tarfile.TarFile) -> Iterator[tuple[tarfile.TarInfo, str]]:
    for member in tar:
        parts = PurePosixPath(member.name).parts
        if member.isfile() and parts[:2] == ("blobs", "sha256"):
            yield member, f"sha256:{parts[-1]}"


def _digest(tar: tarfile.TarFile, member: tarfile.TarInfo) -> str:
    found = hashlib.sha256()
    file = tar.extractfile(member)
    while file and (part := file.read(_STEP)):
        found.update(part)
    return f"sha256:{found.hexdigest()}"


def _read(tar: tarfile.TarFile, member: tarfile.TarInfo) -> dict[str, Any]:
    if member.size > DESCRIPTION_BYTES:
        raise ValueError(f"{member.name} has {member.size:,} bytes, which no description has")
    file = tar.extractfile(member)
    read: dict[str, Any] = json.loads(file.read() if file else b"")
    return read
