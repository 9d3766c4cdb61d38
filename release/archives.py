"""OCI image archives: their blobs checked, and laid out in a folder for whoever pushes them."""

from __future__ import annotations

import hashlib
import json
import tarfile
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path, PurePosixPath
from typing import Any

from archive import add, blob_path

from release import ReleaseError

# A manifest and an index are texts of a few kilobytes; what is larger is neither.
DESCRIPTION_BYTES = 4 << 20
INDEX = "application/vnd.oci.image.index.v1+json"
_STEP = 1 << 20
_NAME = "org.opencontainers.image.ref.name"


@dataclass(frozen=True)
class Archive:
    """An archive with one image: its name and tag, its digest, and its manifest on each platform.

    The digest is that of the index where the image is for several platforms.
    """

    name: str
    digest: str
    manifests: dict[str, str]

    @property
    def platforms(self) -> str:
        return ",".join(self.manifests)


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


def join(parts: Sequence[Path], target: Path, name: str) -> None:
    """Write one image of several platforms, out of an archive for each; they were inspected before.

    The same archives in the same order give the same bytes. Raises ReleaseError.
    """
    described: list[dict[str, Any]] = []
    with tarfile.open(target, "w") as joined:
        add(joined, "oci-layout", b'{"imageLayoutVersion": "1.0.0"}')
        written: set[str] = set()
        for part in parts:
            with tarfile.open(part) as tar:
                described.append(_descriptor(tar, part))
                for member, digest in _blobs(tar):
                    # Two platforms may have a layer in common.
                    if digest not in written:
                        info = tarfile.TarInfo(member.name)
                        info.size = member.size
                        joined.addfile(info, tar.extractfile(member))
                        written.add(digest)
        index = {"schemaVersion": 2, "mediaType": INDEX, "manifests": described}
        content = json.dumps(index).encode()
        digest = hashlib.sha256(content).hexdigest()
        add(joined, blob_path(f"sha256:{digest}"), content)
        top = {
            "mediaType": INDEX, "digest": f"sha256:{digest}", "size": len(content),
            "annotations": {_NAME: name},
        }  # fmt: skip
        add(joined, "index.json", json.dumps({"schemaVersion": 2, "manifests": [top]}).encode())


def _descriptor(tar: tarfile.TarFile, path: Path) -> dict[str, Any]:
    """What an index says of the one image of an archive."""
    (found,) = _read(tar, tar.getmember("index.json"))["manifests"]
    manifest = _read(tar, tar.getmember(blob_path(str(found["digest"]))))
    if "config" not in manifest:
        raise ReleaseError(f"{path} is of several platforms already.")
    config = _read(tar, tar.getmember(blob_path(str(manifest["config"]["digest"]))))
    kept = {key: found[key] for key in ("mediaType", "digest", "size")}
    return kept | {"platform": {"architecture": config["architecture"], "os": config["os"]}}


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
    top = _read(tar, blobs[digest])
    name = str(described[0].get("annotations", {}).get(_NAME, ""))
    if top.get("mediaType") != INDEX:
        return Archive(name, digest, {_platform(path, tar, blobs, digest): digest})
    manifests: dict[str, str] = {}
    for each in top["manifests"]:
        named = f"{each['platform']['os']}/{each['platform']['architecture']}"
        held = _platform(path, tar, blobs, str(each["digest"]))
        if held != named or held in manifests:
            raise ReleaseError(f"{path} has an image of {held} in the place of one of {named}.")
        manifests[named] = str(each["digest"])
    return Archive(name, digest, manifests)


def _platform(
    path: Path, tar: tarfile.TarFile, blobs: dict[str, tarfile.TarInfo], digest: str
) -> str:
    """The platform of an image whose manifest has this digest, with all its blobs there."""
    if digest not in blobs:
        raise ReleaseError(f"{path} lacks {digest}, which its index names.")
    manifest = _read(tar, blobs[digest])
    for each in (manifest["config"], *manifest["layers"]):
        if each["digest"] not in blobs:
            raise ReleaseError(f"{path} lacks {each['digest']}, which its manifest names.")
    config = _read(tar, blobs[manifest["config"]["digest"]])
    return f"{config['os']}/{config['architecture']}"


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
