"""The checksums of a release's files, and their signature by an SSH key.

OpenSSH signs and verifies files with the keys that people have; nothing has to be built for it, and
no service is asked.
"""

from __future__ import annotations

import hashlib
import re
import subprocess
from pathlib import Path

from release import ReleaseError

SUMS = "SHA256SUMS"
SIGNATURE = f"{SUMS}.sig"
# What the signature is for, which who verifies it names as well.
NAMESPACE = "bagpipe-release"
# Long enough to type the passphrase of a key.
SIGN_SECONDS = 120.0
_LINE = re.compile(r"([0-9a-f]{64})  (.+)")


def write(folder: Path) -> Path:
    """Write the SHA-256 of every file of a folder, as `sha256sum --check` reads it."""
    lines = [f"{_sha256(folder / name)}  {name}\n" for name in _files(folder)]
    (folder / SUMS).write_text("".join(lines))
    return folder / SUMS


def check(folder: Path) -> None:
    """Raises ReleaseError unless a folder has the files of its checksums, and no others."""
    try:
        text = (folder / SUMS).read_text()
    except FileNotFoundError as error:
        raise ReleaseError(
            f"{folder} is no release, as it has no {SUMS}: run `make release`."
        ) from error
    wanted = {}
    for line in text.splitlines():
        found = _LINE.fullmatch(line)
        if not found:
            raise ReleaseError(f"{folder / SUMS} has a line that is no checksum: {line[:80]!r}.")
        wanted[found[2]] = found[1]
    files = set(_files(folder))
    faults = [f"{name} is missing" for name in sorted(wanted.keys() - files)]
    faults += [f"{name} is in no line of {SUMS}" for name in sorted(files - wanted.keys())]
    faults += [
        f"{name} was changed"
        for name in sorted(files & wanted.keys())
        if _sha256(folder / name) != wanted[name]
    ]
    if faults:
        raise ReleaseError(f"{folder} is not as it was made: {'; '.join(faults)}.")


def sign(folder: Path, key: Path) -> Path:
    """Sign the checksums with a private SSH key; the signature's path. Raises ReleaseError."""
    (folder / SIGNATURE).unlink(missing_ok=True)
    command = ["ssh-keygen", "-Y", "sign", "-n", NAMESPACE, "-f", str(key), str(folder / SUMS)]
    try:
        done = subprocess.run(
            command, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True,
            timeout=SIGN_SECONDS, check=False,
        )  # fmt: skip
    except FileNotFoundError as error:
        raise ReleaseError(
            "There is no ssh-keygen, which signs: install openssh-client."
        ) from error
    except subprocess.TimeoutExpired as error:
        raise ReleaseError(
            f"ssh-keygen did not sign with {key} in {SIGN_SECONDS:.0f} s."
        ) from error
    if done.returncode:
        raise ReleaseError(f"ssh-keygen could not sign with {key}: {done.stderr.strip()}")
    return folder / SIGNATURE


def _files(folder: Path) -> list[str]:
    own = {SUMS, SIGNATURE}
    names = (str(path.relative_to(folder)) for path in folder.rglob("*") if path.is_file())
    return sorted(name for name in names if name not in own)


def _sha256(path: Path) -> str:
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()
