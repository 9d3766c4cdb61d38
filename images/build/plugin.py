"""Pack `kubectl bagpipe` as a plugin in krew's layout: an archive, and a manifest with its hash.

    .venv/bin/python images/build/plugin.py FOLDER [--uri URI]

The archive has a launcher for kubectl and one for its completion, bagpipe's wheel and its native
module's for this machine's kind, and the pinned list of what they need. The same sources give the
same bytes.
"""

from __future__ import annotations

import argparse
import gzip
import hashlib
import io
import sys
import tarfile
import tempfile
from collections.abc import Sequence
from pathlib import Path

import yaml
from context import EPOCH, ROOT, VERSION, memory_bag, package, requirements
from failure import BuildError
from lock import LockError

NAME = "bagpipe"
LAUNCHER = ROOT / "images/kubectl/kubectl-bagpipe"
# Whoever publishes the archive says where; names below .example belong to nobody.
URI = "https://downloads.example/{file}"
SHORT = "Submit simulation jobs, follow them, and read their results"
DESCRIPTION = """\
Bagpipe replays recorded robot data through the software under test, on Kubernetes. This plugin
submits SimulationJobs, follows them to their verdict with exit codes for a CI, and shows their
logs, results, reports and comparisons.
"""
CAVEATS = """\
The first call installs the program's packages beside the plugin, with python3 (3.11 or later, with
venv) and the package index that pip is configured for. What reads recordings (plan, bag) needs the
native module, which is in the archive for one kind of machine.
"""


def archive(files: Sequence[tuple[str, bytes, int]]) -> bytes:
    """A .tar.gz of (name, content, mode), with nothing in it of the day or the machine."""
    packed = io.BytesIO()
    with tarfile.open(fileobj=packed, mode="w", format=tarfile.USTAR_FORMAT) as tar:
        for name, content, mode in sorted(files):
            entry = tarfile.TarInfo(name)
            entry.size, entry.mode, entry.mtime = len(content), mode, EPOCH
            tar.addfile(entry, io.BytesIO(content))
    return gzip.compress(packed.getvalue(), mtime=0)


def manifest(uri: str, packed: bytes) -> str:
    """krew's description of the plugin."""
    platform = {
        "selector": {
            "matchExpressions": [{"key": "os", "operator": "In", "values": ["linux", "darwin"]}]
        },
        "uri": uri,
        "sha256": hashlib.sha256(packed).hexdigest(),
        "bin": LAUNCHER.name,
    }
    described = {
        "apiVersion": "krew.googlecontainertools.github.com/v1alpha2",
        "kind": "Plugin",
        "metadata": {"name": NAME},
        "spec": {
            "version": f"v{VERSION}",
            "shortDescription": SHORT,
            "description": DESCRIPTION,
            "caveats": CAVEATS,
            "platforms": [platform],
        },
    }
    return yaml.safe_dump(described, sort_keys=False)


def pack(folder: Path, uri: str = URI) -> tuple[Path, Path]:
    """Write archive and manifest into a folder; their paths. Raises BuildError."""
    launcher = LAUNCHER.read_bytes()
    with tempfile.TemporaryDirectory() as scratch:
        package(ROOT / "images" / "spark", Path(scratch))
        (wheel,) = Path(scratch).glob(f"{NAME}-*.whl")
        native = memory_bag(Path(scratch))
        needs = Path(scratch, "requirements.txt")
        requirements(NAME, needs, "cli", "jobs", "storage")
        packed = archive(
            [
                (LAUNCHER.name, launcher, 0o755),
                ("kubectl_complete-bagpipe", launcher, 0o755),
                ("requirements.txt", needs.read_bytes(), 0o644),
                (wheel.name, wheel.read_bytes(), 0o644),
                (native.name, native.read_bytes(), 0o644),
                ("LICENSE", (ROOT / "LICENSE").read_bytes(), 0o644),
            ]
        )
    folder.mkdir(parents=True, exist_ok=True)
    target = folder / f"kubectl-{NAME}-v{VERSION}.tar.gz"
    target.write_bytes(packed)
    described = folder / f"{NAME}.yaml"
    described.write_text(manifest(uri.format(file=target.name), packed))
    return target, described


def main(arguments: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else "")
    parser.add_argument("folder", type=Path, help="where archive and manifest are written")
    parser.add_argument("--uri", default=URI, help="where the archive will be published")
    options = parser.parse_args(arguments)
    try:
        for path in pack(options.folder, options.uri):
            print(f"{path}: {path.stat().st_size:,} bytes")
    except (BuildError, LockError) as error:
        print(f"Packing the plugin failed. {error}", file=sys.stderr)
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
