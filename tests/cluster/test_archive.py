"""What `docker save` writes is an OCI archive afterwards, as the cluster's loading reads it."""

from __future__ import annotations

import hashlib
import io
import json
import tarfile
from pathlib import Path
from typing import Any

from archive import make_oci
from embedded.oci import names_and_digests

NAME = "bagpipe.local/probe:0.2.0"
LAYERS = [b"first layer", b"second", b"first layer"]


def digest(content: bytes) -> str:
    return hashlib.sha256(content).hexdigest()


def add(tar: tarfile.TarFile, path: str, content: bytes) -> None:
    info = tarfile.TarInfo(path)
    info.size = len(content)
    tar.addfile(info, io.BytesIO(content))


def saved_by_docker_20(path: Path) -> bytes:
    """Three layers of which the last is the first again; returns the image's configuration."""
    ids = [f"sha256:{digest(layer)}" for layer in LAYERS]
    config = json.dumps({"os": "linux", "rootfs": {"type": "layers", "diff_ids": ids}}).encode()
    with tarfile.open(path, "w") as tar:
        add(tar, f"{digest(config)}.json", config)
        for n, layer in enumerate(LAYERS[:2]):
            add(tar, f"{n}/layer.tar", layer)
        link = tarfile.TarInfo("2/layer.tar")
        link.type, link.linkname = tarfile.SYMTYPE, "../0/layer.tar"
        tar.addfile(link)
        layers = [f"{n}/layer.tar" for n in range(3)]
        image = {"Config": f"{digest(config)}.json", "RepoTags": [NAME], "Layers": layers}
        add(tar, "manifest.json", json.dumps([image]).encode())
    return config


def blob(tar: tarfile.TarFile, descriptor: dict[str, Any]) -> bytes:
    file = tar.extractfile("blobs/" + descriptor["digest"].replace(":", "/"))
    assert file is not None
    content = file.read()
    assert descriptor["digest"] == f"sha256:{digest(content)}"
    assert descriptor["size"] == len(content)
    return content


def test_what_docker_20_saves_becomes_an_oci_archive(tmp_path: Path) -> None:
    config = saved_by_docker_20(tmp_path / "saved")
    make_oci(tmp_path / "saved", tmp_path / "archive", NAME)
    found = names_and_digests(tmp_path / "archive")
    assert list(found) == [NAME]
    with tarfile.open(tmp_path / "archive") as tar:
        index = json.loads(tar.extractfile("index.json").read())  # type: ignore[union-attr]
        manifest = json.loads(blob(tar, index["manifests"][0]))
        assert blob(tar, manifest["config"]) == config
        assert [blob(tar, layer) for layer in manifest["layers"]] == LAYERS
        assert len(tar.getnames()) == len(set(tar.getnames()))


def test_what_is_an_oci_archive_already_stays_as_it_is(tmp_path: Path) -> None:
    with tarfile.open(tmp_path / "saved", "w") as tar:
        add(tar, "index.json", b"{}")
    written = (tmp_path / "saved").read_bytes()
    make_oci(tmp_path / "saved", tmp_path / "archive", NAME)
    assert (tmp_path / "archive").read_bytes() == written
    assert not (tmp_path / "saved").exists()
