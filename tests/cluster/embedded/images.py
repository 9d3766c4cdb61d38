"""Images for the cluster: they come from archives, because there is no registry."""

from __future__ import annotations

import time
from pathlib import Path

from .containerd import ctr
from .failure import ClusterError
from .oci import names_and_digests
from .places import Node, cache, nodes


def folder() -> Path:
    """Where images/build/build.py leaves its archives, one an image: <name>.oci.tar."""
    return cache() / "images"


def archive_of(image: str) -> Path:
    """The archive for a path, or for an image of this project by its name."""
    if Path(image).is_file():
        return Path(image)
    name = image.rpartition("/")[2].partition(":")[0]
    path = folder() / f"{name}.oci.tar"
    if not path.exists():
        raise ClusterError(f"There is no archive {image} and no {path}; run `make images` first.")
    return path


def parse_listing(text: str) -> dict[str, str]:
    """Image name -> digest from what `ctr images list` prints."""
    rows = (line.split() for line in text.splitlines()[1:])
    return {row[0]: row[2] for row in rows if len(row) > 2}


def load(images: list[str]) -> None:
    """Import archives (all that were built, if none is named) that a node has not yet."""
    archives = [archive_of(i) for i in images] or built()
    if not archives:
        raise ClusterError(f"There are no archives in {folder()}; run `make images` first.")
    for node in nodes():
        load_on(node, archives)


def built() -> list[Path]:
    """The archives of all images that were built."""
    return sorted(folder().glob("*.oci.tar"))


def load_on(node: Node, archives: list[Path]) -> None:
    """Import those of the archives that the node has not yet."""
    loaded = parse_listing(ctr(node, "images", "list"))
    for archive in archives:
        found = names_and_digests(archive)
        if all(loaded.get(name) == digest for name, digest in found.items()):
            print(f"  {', '.join(found)}: already on {node.name}")
            continue
        began = time.monotonic()
        ctr(node, "images", "import", archive)
        seconds = time.monotonic() - began
        print(f"  {', '.join(found)}: loaded on {node.name} in {seconds:.1f} s", flush=True)
