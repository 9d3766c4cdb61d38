"""What is in a release, as CycloneDX: Debian's packages, Python's, jars and crates, by syft.

One list for each image and platform, out of its archive, and one of the crates that the agent and
the native module are compiled from: a static binary says nothing of them.
"""

from __future__ import annotations

import json
import os
import subprocess
from pathlib import Path

from embedded import builds

from release import ReleaseError
from release.version import ROOT

SCAN_SECONDS = 900.0
# Files are no components: an image has thousands, each part of a package that is listed.
_SETTINGS = {"SYFT_CHECK_FOR_APP_UPDATE": "false", "SYFT_FILE_METADATA_SELECTION": "none"}


def of_image(archive: Path, name: str, version: str, arch: str, folder: Path) -> Path:
    """List what an image's archive for one architecture holds; the list's path.

    Raises ReleaseError.
    """
    target = folder / f"{name}-{version}-{arch}.cdx.json"
    return _list(f"oci-archive:{archive}", name, version, target)


def of_crates(version: str, folder: Path) -> Path:
    """List the crates of Cargo.lock, those of the tests among them. Raises ReleaseError."""
    lock = ROOT / "images/agent/Cargo.lock"
    return _list(f"file:{lock}", "crates", version, folder / f"crates-{version}.cdx.json")


def _list(source: str, name: str, version: str, target: Path) -> Path:
    target.parent.mkdir(parents=True, exist_ok=True)
    command = [str(builds.ensure(builds.CONTENTS) / "syft"), "scan", source, "--quiet"]
    command += ["--source-name", f"bagpipe/{name}", "--source-version", version]
    done = subprocess.run(
        [*command, "--output", "cyclonedx-json"], env={**os.environ, **_SETTINGS},
        capture_output=True, text=True, timeout=SCAN_SECONDS, check=False,
    )  # fmt: skip
    if done.returncode:
        raise ReleaseError(f"syft could not list what is in {source}: {done.stderr.strip()}")
    listed = json.loads(done.stdout)
    # Of the moment and by chance: without them the same image has the same list.
    listed.pop("serialNumber", None)
    listed["metadata"].pop("timestamp", None)
    target.write_text(json.dumps(listed, indent=1) + "\n")
    return target
