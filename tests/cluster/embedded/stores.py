"""Images for several nodes at the price of one: the first node's store, linked into the others'.

One containerd can't serve two kubelets, and each would unpack every image again: minutes of
work and gigabytes of disk. So the first containerd imports all images while no container exists
yet, stops, and the others start with a copy of its store in which every file is a hard link.
What containerd has unpacked is only ever read (a container writes to a layer of its own), and
removing an image unlinks names, so no node can take anything from another.
"""

from __future__ import annotations

import subprocess
import time
from pathlib import Path

from . import containerd, images, processes
from .failure import ClusterError
from .places import Node

# Parts of containerd's root: blobs of images, unpacked layers, and what ties them together.
PARTS = (
    "io.containerd.content.v1.content",
    "io.containerd.snapshotter.v1.overlayfs",
    "io.containerd.metadata.v1.bolt",
)
DATABASES = "*.db"


def share(nodes: list[Node], binaries: Path) -> None:
    """Import all built images on the first node and give the others its store.

    No containerd runs afterwards. There must be no containers on any node yet.
    """
    first, *others = nodes
    containerd.start_on(first, binaries)
    images.load_on(first, images.built())
    processes.stop([containerd.daemon_name(first)])
    began = time.monotonic()
    for other in others:
        link_store(containerd.root(first), containerd.root(other))
    seconds = time.monotonic() - began
    print(f"  images linked into {len(others)} more nodes in {seconds:.1f} s", flush=True)


def link_store(source: Path, target: Path) -> None:
    """Make `target` a copy of a containerd's root `source` whose files are hard links.

    The databases are true copies: they are the files that containerd writes in place. Both
    folders must be on one file system.
    """
    target.mkdir(parents=True, exist_ok=True)
    for part in PARTS:
        command = ["cp", "--archive", "--link", str(source / part), str(target)]
        done = subprocess.run(command, capture_output=True, text=True, check=False)
        if done.returncode:
            last = done.stderr.strip().splitlines()[-1:]
            raise ClusterError(f"The store {source} can't be linked to {target}: {last}")
        for linked in (target / part).glob(DATABASES):
            own = linked.with_suffix(".own")
            own.write_bytes(linked.read_bytes())
            own.chmod(0o600)
            own.replace(linked)
