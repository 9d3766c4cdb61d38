"""OCI image archives: reading what one holds, and writing the simplest there is."""

from __future__ import annotations

import hashlib
import io
import json
import platform
import tarfile
from pathlib import Path
from typing import Any

from .failure import ClusterError

NAME_ANNOTATION = "org.opencontainers.image.ref.name"
MANIFEST = "application/vnd.oci.image.manifest.v1+json"


def names_and_digests(archive: Path) -> dict[str, str]:
    """The images of an archive: name with tag -> digest of its manifest."""
    try:
        with tarfile.open(archive) as tar:
            member = tar.extractfile("index.json")
            index: dict[str, Any] = json.load(member) if member else {}
    except (OSError, KeyError, tarfile.TarError, ValueError) as error:
        raise ClusterError(f"{archive} is not an OCI image archive: {error}") from error
    found = {}
    for manifest in index.get("manifests", []):
        annotations = manifest.get("annotations") or {}
        name = annotations.get("io.containerd.image.name") or annotations.get(NAME_ANNOTATION)
        if name:
            found[str(name)] = str(manifest["digest"])
    if not found:
        raise ClusterError(f"{archive} names no image in its index.json; push it with a name.")
    return found


class _Layout:
    """An OCI layout being written into a tar file."""

    def __init__(self, tar: tarfile.TarFile) -> None:
        self._tar = tar

    def file(self, path: str, content: bytes) -> None:
        info = tarfile.TarInfo(path)
        info.size = len(content)
        self._tar.addfile(info, io.BytesIO(content))

    def blob(self, media_type: str, content: bytes) -> dict[str, Any]:
        """Add a blob and return its descriptor."""
        digest = hashlib.sha256(content).hexdigest()
        self.file(f"blobs/sha256/{digest}", content)
        return {"mediaType": media_type, "digest": f"sha256:{digest}", "size": len(content)}


def write_single_binary(
    archive: Path, name: str, binary: Path, inside: str, arch: str = ""
) -> None:
    """Write an image that holds one static program and runs it. Same input, same bytes."""
    buffer = io.BytesIO()
    with tarfile.open(fileobj=buffer, mode="w") as layer:
        info = tarfile.TarInfo(inside.lstrip("/"))
        content = binary.read_bytes()
        info.size, info.mode = len(content), 0o755
        layer.addfile(info, io.BytesIO(content))
    diff = "sha256:" + hashlib.sha256(buffer.getvalue()).hexdigest()
    config = {
        "architecture": arch or {"x86_64": "amd64", "aarch64": "arm64"}[platform.machine()],
        "os": "linux",
        "config": {"Entrypoint": [inside]},
        "rootfs": {"type": "layers", "diff_ids": [diff]},
    }
    with tarfile.open(archive, "w") as tar:
        layout = _Layout(tar)
        layout.file("oci-layout", b'{"imageLayoutVersion":"1.0.0"}')
        manifest = {
            "schemaVersion": 2,
            "mediaType": MANIFEST,
            "config": layout.blob(
                "application/vnd.oci.image.config.v1+json", json.dumps(config).encode()
            ),
            "layers": [layout.blob("application/vnd.oci.image.layer.v1.tar", buffer.getvalue())],
        }
        descriptor = layout.blob(MANIFEST, json.dumps(manifest).encode())
        descriptor["annotations"] = {NAME_ANNOTATION: name}
        layout.file(
            "index.json", json.dumps({"schemaVersion": 2, "manifests": [descriptor]}).encode()
        )
