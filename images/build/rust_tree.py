"""Debian's rustc with the standard library of another architecture, unpacked into the cache.

Nothing of it is installed: it is started by its own loader, with its own libraries. What it
compiles is linked by the machine's compilers, against their glibc.
"""

from __future__ import annotations

import os
import shlex
import shutil
import subprocess
import tempfile
from pathlib import Path

from failure import BuildError
from lock import locked

FETCH_SECONDS = 900.0
APT_SECONDS = 60.0
# Backports keep up with Rust, and stable's is older than what the crates ask for.
SUITE = "trixie"
LOADERS = {
    "x86_64": "usr/lib/x86_64-linux-gnu/ld-linux-x86-64.so.2",
    "aarch64": "usr/lib/aarch64-linux-gnu/ld-linux-aarch64.so.1",
}


def lacking() -> str:
    """Why the tree can't be made here, or nothing."""
    if not shutil.which("mmdebstrap"):
        return "there is no mmdebstrap to get Debian's"
    if not mirror():
        return "apt knows no mirror of Debian's before an `apt-get update`"
    return ""


def mirror() -> str:
    """Where this machine's apt gets Debian's packages; empty where it gets none there."""
    found = ["apt-get", "indextargets", "--format", "$(REPO_URI)"]
    try:
        done = subprocess.run(
            [*found, "Created-By: Packages", "Label: Debian"], stdin=subprocess.DEVNULL,
            capture_output=True, text=True, timeout=APT_SECONDS, check=False,
        )  # fmt: skip
    except FileNotFoundError:
        return ""
    return next(iter(done.stdout.split()), "")


def rustc(arch: str, own: str, cache: Path) -> Path:
    """A program that is Debian's rustc, of a machine that is `own`, with the library for
    `arch`. Raises BuildError."""
    folder = cache / "rust" / arch
    program = folder / "rustc"
    with locked(cache / "rust" / f"{arch}.lock", FETCH_SECONDS):
        if not program.exists():
            shutil.rmtree(folder, ignore_errors=True)
            folder.parent.mkdir(parents=True, exist_ok=True)
            made = Path(tempfile.mkdtemp(prefix=f".{arch}-", dir=folder.parent))
            try:
                _fetch(command(made / "tree", arch, own), arch)
                write_program(made / "rustc", folder / "tree")
                made.replace(folder)
            finally:
                shutil.rmtree(made, ignore_errors=True)
    return program


def command(target: Path, arch: str, own: str) -> list[str]:
    """What unpacks Debian's rustc, of this machine, and the library into a folder."""
    include = f"rustc,libstd-rust-dev:{arch}"
    backports, source = f"{SUITE}-backports", mirror()
    made = ["mmdebstrap", "--variant=extract", f"--architectures={own},{arch}"]
    made += [f"--include={include}", f'--aptopt=Apt::Default-Release "{backports}"']
    return [
        *made, SUITE, str(target), f"deb {source} {SUITE} main", f"deb {source} {backports} main"
    ]  # fmt: skip


def _fetch(words: list[str], arch: str) -> None:
    print(f"  getting Debian's rustc with the library for {arch}: 1.1 GB in the cache", flush=True)
    try:
        done = subprocess.run(
            words, stdin=subprocess.DEVNULL, capture_output=True, text=True,
            timeout=FETCH_SECONDS, check=False,
        )  # fmt: skip
    except subprocess.TimeoutExpired as error:
        raise BuildError(f"Debian's rustc did not come in {FETCH_SECONDS:.0f} s.") from error
    if done.returncode:
        last = "\n".join(done.stderr.splitlines()[-10:])
        raise BuildError(f"Debian's rustc could not be got; mmdebstrap's last lines:\n{last}")


def write_program(path: Path, tree: Path) -> None:
    """Write the program that starts the tree's rustc with the tree's own libraries."""
    loader = tree / LOADERS[os.uname().machine]
    folder, sysroot = loader.parent, tree / "usr"
    words = [loader, "--library-path", folder, sysroot / "bin/rustc", "--sysroot", sysroot]
    path.write_text(f'#!/bin/sh\nexec {shlex.join(map(str, words))} "$@"\n')
    path.chmod(0o755)
