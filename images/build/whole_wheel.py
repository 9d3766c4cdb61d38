"""One wheel for a laptop: bagpipe, its native module, and the agent as a program beside it.

Format: https://packaging.python.org/specifications/binary-distribution-format.
"""

from __future__ import annotations

import base64
import hashlib
import time
import zipfile
from collections.abc import Mapping
from pathlib import Path

from context import EPOCH
from failure import BuildError

_FILE, _PROGRAM = 0o100644, 0o100755


def whole_wheel(bagpipe: Path, native: Path, agent: Path, folder: Path) -> Path:
    """Write the wheel that has all of bagpipe's, the module's package and the agent as a script.

    It is for the machines that the native module's wheel is for. The same files give the same
    bytes. Raises BuildError.
    """
    name, version, *_ = bagpipe.stem.split("-")
    tags = "-".join(native.stem.split("-")[2:])
    files = _files(bagpipe)
    info = f"{name}-{version}.dist-info"
    if files.pop(f"{info}/RECORD", None) is None:
        raise BuildError(f"{bagpipe.name} has no RECORD: it is no wheel of {name} {version}.")
    files |= {path: data for path, data in _files(native).items() if ".dist-info/" not in path}
    lines = files[f"{info}/WHEEL"].decode().splitlines()
    kept = [line for line in lines if line and not line.startswith(("Root-Is-Purelib:", "Tag:"))]
    described = [*kept, "Root-Is-Purelib: false", f"Tag: {tags}", ""]
    files[f"{info}/WHEEL"] = "\n".join(described).encode()
    script = f"{name}-{version}.data/scripts/{agent.name}"
    files[script] = agent.read_bytes()
    files[f"{info}/RECORD"] = _record(files, f"{info}/RECORD")
    target = folder / f"{name}-{version}-{tags}.whl"
    with zipfile.ZipFile(target, "w", zipfile.ZIP_DEFLATED) as wheel:
        # The RECORD comes last, as the specification recommends.
        for path in sorted(files, key=lambda path: (path.endswith("/RECORD"), path)):
            entry = zipfile.ZipInfo(path, time.gmtime(EPOCH)[:6])
            entry.compress_type = zipfile.ZIP_DEFLATED
            entry.external_attr = (_PROGRAM if path == script else _FILE) << 16
            wheel.writestr(entry, files[path])
    return target


def _files(wheel: Path) -> dict[str, bytes]:
    with zipfile.ZipFile(wheel) as opened:
        return {name: opened.read(name) for name in opened.namelist()}


def _record(files: Mapping[str, bytes], own: str) -> bytes:
    """Each file with its SHA-256 and its size, and itself without."""

    def line(path: str, data: bytes) -> str:
        digest = base64.urlsafe_b64encode(hashlib.sha256(data).digest()).rstrip(b"=").decode()
        return f"{path},sha256={digest},{len(data)}\n"

    return "".join([*(line(path, files[path]) for path in sorted(files)), f"{own},,\n"]).encode()
