"""What Docker saves, made an OCI archive: before 25.0 it saves in a format of its own.

Only OCI's names the digest by which a cluster knows that a node has the image already.
"""

from __future__ import annotations

import hashlib
import io
import json
import posixpath
import tarfile
from pathlib import Path
from typing import Any

INDEX = "index.json"
TYPE = "application/vnd.oci.image"


def make_oci(saved: Path, archive: Path, name: str) -> None:
    """Write what `docker save` wrote of the image `name` as an OCI archive."""
    with tarfile.open(saved) as source:
        if INDEX not in source.getnames():
            with tarfile.open(archive, "w") as target:
                _convert(source, target, name)
            return
    saved.replace(archive)


def _convert(source: tarfile.TarFile, target: tarfile.TarFile, name: str) -> None:
    [image] = json.loads(_content(source, "manifest.json"))
    config = _content(source, image["Config"])
    digests = json.loads(config)["rootfs"]["diff_ids"]
    layers = [_member(source, path) for path in image["Layers"]]
    # The same layer may be in an image twice.
    for digest, member in dict(zip(digests, layers, strict=True)).items():
        info = tarfile.TarInfo(blob_path(digest))
        info.size = member.size
        target.addfile(info, source.extractfile(member))
    manifest: dict[str, Any] = {
        "schemaVersion": 2,
        "mediaType": f"{TYPE}.manifest.v1+json",
        "config": _blob(target, f"{TYPE}.config.v1+json", config),
        "layers": [
            {"mediaType": f"{TYPE}.layer.v1.tar", "digest": digest, "size": member.size}
            for digest, member in zip(digests, layers, strict=True)
        ],
    }
    described = _blob(target, manifest["mediaType"], json.dumps(manifest).encode())
    described["annotations"] = {"org.opencontainers.image.ref.name": name}
    index = {"schemaVersion": 2, "manifests": [described]}
    add(target, "oci-layout", b'{"imageLayoutVersion": "1.0.0"}')
    add(target, INDEX, json.dumps(index).encode())


def _member(tar: tarfile.TarFile, path: str) -> tarfile.TarInfo:
    """A layer that Docker wrote already is a link to where it did."""
    found = tar.getmember(path)
    if found.issym():
        return tar.getmember(posixpath.normpath(posixpath.join(path, "..", found.linkname)))
    return found


def _content(tar: tarfile.TarFile, path: str) -> bytes:
    file = tar.extractfile(path)
    return file.read() if file else b""


def blob_path(digest: str) -> str:
    """Where an OCI layout has a blob."""
    return "blobs/" + digest.replace(":", "/")


def add(tar: tarfile.TarFile, path: str, content: bytes) -> None:
    """Add a file of these bytes, with nothing that another run would have otherwise."""
    info = tarfile.TarInfo(path)
    info.size = len(content)
    tar.addfile(info, io.BytesIO(content))


def _blob(tar: tarfile.TarFile, media_type: str, content: bytes) -> dict[str, Any]:
    """Add a blob and return its descriptor."""
    digest = f"sha256:{hashlib.sha256(content).hexdigest()}"
    add(tar, blob_path(digest), content)
    return {"mediaType": media_type, "digest": digest, "size": len(content)}
