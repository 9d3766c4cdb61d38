"""Compiling for machines of another architecture than this one: the linker, and whose Rust.

The C compiler is Debian's cross compiler. Rust's standard library for the target is rustup's
where it is installed (`rustup target add`); else a whole rustc of Debian's that has one comes into
the cache (rust_tree.py), since a library of another version than the compiler's can't be used.
"""

from __future__ import annotations

import platform
import shutil
import subprocess
from dataclasses import dataclass
from pathlib import Path

import rust_tree
from failure import BuildError

RUSTC_SECONDS = 60.0


@dataclass(frozen=True)
class Target:
    """An architecture by its names: OCI's, the kernel's, Rust's and the GNU tools'."""

    arch: str
    machine: str
    triple: str
    gnu: str

    @property
    def platform(self) -> str:
        return f"linux/{self.arch}"

    @property
    def package(self) -> str:
        """Debian's cross compiler for it."""
        return f"gcc-{self.gnu.replace('_', '-')}"


TARGETS = (
    Target("amd64", "x86_64", "x86_64-unknown-linux-gnu", "x86_64-linux-gnu"),
    Target("arm64", "aarch64", "aarch64-unknown-linux-gnu", "aarch64-linux-gnu"),
)


def own(machine: str = "") -> Target:
    """What this machine is. Raises BuildError where Bagpipe is not built for such ones."""
    found = machine or platform.machine()
    for each in TARGETS:
        if each.machine == found:
            return each
    raise BuildError(f"This machine is {found}, and Bagpipe is built on x86_64 and aarch64.")


def named(words: str) -> list[Target]:
    """The targets of `linux/amd64 linux/arm64`, this machine's first. Raises BuildError."""
    known = {each.platform: each for each in TARGETS}
    wanted = words.replace(",", " ").split()
    unknown = [word for word in wanted if word not in known]
    if unknown or not wanted:
        raise BuildError(
            f"There is no platform {', '.join(unknown) or 'named'}: there are {' '.join(known)}."
        )
    here = own()
    if here.platform not in wanted:
        raise BuildError(f"{here.platform} is this machine's own, and is always among them.")
    return sorted({known[word] for word in wanted}, key=lambda each: (each != here, each.arch))


def lacking(targets: list[Target]) -> list[str]:
    """A sentence for each target that can't be compiled for here: what is missing, and its cure."""
    found = []
    for each in targets:
        if each == own():
            continue
        if not shutil.which(f"{each.gnu}-gcc"):
            found.append(
                f"For {each.platform} there is no {each.gnu}-gcc: `apt-get install {each.package}`."
            )
        if not _rustup_has(each) and (why := rust_tree.lacking()):
            found.append(
                f"For {each.platform} Rust has no standard library here, and {why}:"
                f" `rustup target add {each.triple}`."
            )
    return found


def possible(words: str) -> list[Target]:
    """The named targets, all of which can be compiled for here. Raises BuildError."""
    found = named(words)
    if missing := lacking(found):
        raise BuildError(f"{' '.join(missing)} Or leave it out, by PLATFORMS={own().platform}.")
    return found


def environment(target: Target, cache: Path) -> dict[str, str]:
    """What cargo is given to compile for a target; a Rust that it gets is kept in `cache`.

    Raises BuildError.
    """
    missing = lacking([target])
    if missing:
        raise BuildError(" ".join(missing))
    variable = target.triple.upper().replace("-", "_")
    found = {
        f"CARGO_TARGET_{variable}_LINKER": f"{target.gnu}-gcc",
        # Of each build.rs here, and of the crate `cc`, which has the others for this machine.
        "CC": f"{target.gnu}-gcc",
        "AR": f"{target.gnu}-ar",
        "HOST_CC": "cc",
        "HOST_AR": "ar",
    }
    if not _rustup_has(target):
        found["RUSTC"] = str(rust_tree.rustc(target.arch, own().arch, cache))
    return found


def _rustup_has(target: Target) -> bool:
    """Whether the machine's rustc has the target's standard library, as rustup installs it."""
    command = ["rustc", "--print", "target-libdir", "--target", target.triple]
    try:
        done = subprocess.run(
            command, capture_output=True, text=True, timeout=RUSTC_SECONDS, check=False
        )
    except FileNotFoundError:
        return False
    return done.returncode == 0 and any(Path(done.stdout.strip()).glob("libstd-*.rlib"))
