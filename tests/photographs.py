"""Real photographs, out of the Python package ultralytics, which carries two as samples.

They are fetched by pip from the registry that the machine uses anyway, kept in Bagpipe's cache,
and never become part of the project. Nothing of the package itself is installed or run.
"""

import hashlib
import os
import subprocess
import sys
import tempfile
import zipfile
from pathlib import Path

from tests.cached import cache

PACKAGE = "ultralytics==8.4.190"
# A street with a bus and people on foot (810 x 1080), and two men up close (1280 x 720).
STREET, PORTRAIT = "bus.jpg", "zidane.jpg"
SHA256 = {
    STREET: "c02019c4979c191eb739ddd944445ef408dad5679acab6fd520ef9d434bfbc63",
    PORTRAIT: "16d73869e3267a7d4ed00de8e860833bd1657c1b252e94c0c348277adc7b6edb",
}
_DEADLINE_SECONDS = 300


class PhotographError(Exception):
    """The photographs can't be had; the sentence says what to do."""


def fetch() -> dict[str, Path]:
    """The photographs' paths by name, fetched first where needed. Raises PhotographError."""
    folder = cache() / "photographs"
    paths = {name: folder / name for name in SHA256}
    if not all(path.exists() and _is_known(name, path) for name, path in paths.items()):
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryDirectory() as place:
            _unpack(_download(Path(place)), paths)
    return paths


def _is_known(name: str, path: Path) -> bool:
    return hashlib.sha256(path.read_bytes()).hexdigest() == SHA256[name]


def _download(folder: Path) -> Path:
    command = [sys.executable, "-m", "pip", "download", "--no-deps", "--quiet", "--dest"]
    done = subprocess.run(
        [*command, str(folder), PACKAGE],
        capture_output=True,
        text=True,
        timeout=_DEADLINE_SECONDS,
        check=False,
    )
    found = sorted(folder.glob("*.whl"))
    if done.returncode or not found:
        raise PhotographError(
            f"pip can't download {PACKAGE}: {done.stderr.strip()[-500:]};"
            " is the package registry reachable?"
        )
    return found[0]


def _unpack(wheel: Path, paths: dict[str, Path]) -> None:
    with zipfile.ZipFile(wheel) as archive:
        for name, path in paths.items():
            part = path.with_suffix(f".{os.getpid()}.part")
            part.write_bytes(archive.read(f"ultralytics/assets/{name}"))
            if not _is_known(name, part):
                raise PhotographError(f"{name} of {PACKAGE} is not what the tests know")
            part.replace(path)
