"""Programs of arm64 on another machine: QEMU's user mode, and a Python of Debian's for it.

Both are unpacked into the cache, and nothing is registered in the kernel: each program is started
by the emulator.
"""

from __future__ import annotations

import shutil
import subprocess
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from context import cache
from lock import locked

FETCH_SECONDS = 900.0
RUN_SECONDS = 120.0


@dataclass(frozen=True)
class Emulator:
    """QEMU for arm64, and the folder with what arm64's dynamic programs load."""

    program: Path
    libraries: Path

    def command(self, program: Path, *words: str) -> list[str]:
        return [str(self.program), "-L", str(self.libraries), str(program), *words]

    def run(self, program: Path, *words: str, **settings: str) -> str:
        """What a program that ends well prints."""
        done = subprocess.run(
            self.command(program, *words), capture_output=True, text=True, timeout=RUN_SECONDS,
            check=False, env={"PATH": "/usr/bin:/bin", **settings},
        )  # fmt: skip
        assert done.returncode == 0, done.stderr
        return done.stdout

    @property
    def python(self) -> Path:
        return self.libraries / "usr/bin/python3.11"


def emulator() -> Emulator:
    """The emulator and its folder, fetched unless they are there."""
    return Emulator(
        _unpacked("qemu", "qemu-user-static") / "usr/bin/qemu-aarch64-static",
        _unpacked("python", "python3-minimal", "--architectures=arm64"),
    )


def _unpacked(name: str, package: str, *options: str) -> Path:
    """The files of a package of Debian's, and of what it needs."""
    folder = cache() / "emulated" / name
    with locked(folder.with_suffix(".lock"), FETCH_SECONDS):
        if not folder.exists():
            made = folder.with_suffix(".new")
            shutil.rmtree(made, ignore_errors=True)
            _fetch([*options, f"--include={package}", "bookworm", str(made)])
            made.replace(folder)
    return folder


def _fetch(words: Sequence[str]) -> None:
    done = subprocess.run(
        ["mmdebstrap", "--variant=extract", *words], capture_output=True, text=True,
        timeout=FETCH_SECONDS, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr[-2000:]
