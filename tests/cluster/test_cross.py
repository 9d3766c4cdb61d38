"""For which machines things are compiled, by which compiler, and by whose Rust."""

from __future__ import annotations

import functools
import subprocess
from pathlib import Path

import build
import context
import cross
import engines
import pytest
import rust_tree
from context import IMAGES
from embedded import preflight
from failure import BuildError

AMD64, ARM64 = cross.TARGETS
MIRROR = "http://mirror.test/debian/"
WITHOUT_STD = "For linux/arm64 Rust has no standard library here"


@pytest.fixture
def machine(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """An x86-64 machine on whose PATH are this folder's programs alone: rustc without more."""
    monkeypatch.setattr(cross.platform, "machine", lambda: "x86_64")
    programs = tmp_path / "bin"
    programs.mkdir()
    monkeypatch.setenv("PATH", str(programs))
    monkeypatch.setenv("BAGPIPE_CACHE", str(tmp_path / "cache"))
    program(programs, "rustc", f"echo {tmp_path}/rustup/lib")
    return tmp_path


def program(folder: Path, name: str, does: str = "exit 1") -> None:
    (folder / name).write_text(f"#!/bin/sh\n{does}\n")
    (folder / name).chmod(0o755)


def apt_knows(machine: Path, mirror: str) -> None:
    """Has apt, asked for Debian's own packages, name where it gets them."""
    program(
        machine / "bin", "apt-get",
        f'[ "$1 $4 $5" = "indextargets Created-By: Packages Label: Debian" ] && echo "{mirror}"',
    )  # fmt: skip


def add_target(machine: Path) -> None:
    """What `rustup target add` does."""
    (machine / "rustup/lib").mkdir(parents=True)
    (machine / "rustup/lib/libstd-0123.rlib").touch()


def test_platforms_are_named_in_any_order_and_the_machine_s_own_is_first(machine: Path) -> None:
    assert machine
    assert cross.named("linux/arm64,linux/amd64 linux/arm64") == [AMD64, ARM64]
    assert cross.named("linux/amd64") == [AMD64]


@pytest.mark.parametrize(
    ("words", "why"),
    [
        ("linux/amd64 linux/riscv64", "There is no platform linux/riscv64: there are linux/amd64"),
        ("", "There is no platform named: there are linux/amd64 linux/arm64."),
        ("linux/arm64", "linux/amd64 is this machine's own, and is always among them."),
    ],
)
def test_other_platforms_are_refused(machine: Path, words: str, why: str) -> None:
    assert machine
    with pytest.raises(BuildError) as caught:
        cross.named(words)
    assert str(caught.value).startswith(why)


def test_all_that_is_missing_is_named_at_once_with_its_cure(machine: Path) -> None:
    with pytest.raises(BuildError) as caught:
        cross.possible("linux/amd64 linux/arm64")
    assert str(caught.value) == (
        "For linux/arm64 there is no aarch64-linux-gnu-gcc: `apt-get install"
        f" gcc-aarch64-linux-gnu`. {WITHOUT_STD}, and there is no mmdebstrap to get Debian's:"
        " `rustup target add aarch64-unknown-linux-gnu`. Or leave it out, by"
        " PLATFORMS=linux/amd64."
    )
    assert cross.possible("linux/amd64") == [AMD64]
    program(machine / "bin", "aarch64-linux-gnu-gcc")
    program(machine / "bin", "mmdebstrap")
    apt_knows(machine, MIRROR)
    assert cross.possible("linux/amd64 linux/arm64") == [AMD64, ARM64]


def test_rustup_s_library_is_taken_where_it_is(machine: Path) -> None:
    program(machine / "bin", "aarch64-linux-gnu-gcc")
    add_target(machine)
    assert cross.environment(ARM64, machine) == {
        "CARGO_TARGET_AARCH64_UNKNOWN_LINUX_GNU_LINKER": "aarch64-linux-gnu-gcc",
        "CC": "aarch64-linux-gnu-gcc",
        "AR": "aarch64-linux-gnu-ar",
        "HOST_CC": "cc",
        "HOST_AR": "ar",
    }


def test_else_debian_s_rustc_is_got_once(machine: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    program(machine / "bin", "aarch64-linux-gnu-gcc")
    program(machine / "bin", "mmdebstrap")
    apt_knows(machine, MIRROR)
    got: list[list[str]] = []

    def fetch(words: list[str], arch: str) -> None:
        got.append(words)
        assert arch == "arm64"

    monkeypatch.setattr(rust_tree, "_fetch", fetch)
    wanted = str(machine / "rust/arm64/rustc")
    for _ in range(2):
        assert cross.environment(ARM64, machine)["RUSTC"] == wanted
    (words,) = got
    assert "--include=rustc,libstd-rust-dev:arm64" in words
    assert "--architectures=amd64,arm64" in words
    # From where the machine's own packages come.
    assert words[-2:] == [
        f"deb {MIRROR} trixie main",
        f"deb {MIRROR} trixie-backports main",
    ]


def test_where_apt_knows_no_mirror_that_is_what_is_missing(machine: Path) -> None:
    program(machine / "bin", "aarch64-linux-gnu-gcc")
    program(machine / "bin", "mmdebstrap")
    apt_knows(machine, "")
    with pytest.raises(BuildError, match="apt knows no mirror of Debian's before an"):
        cross.environment(ARM64, machine)


def test_a_library_that_did_not_come_leaves_nothing_behind(machine: Path) -> None:
    program(machine / "bin", "aarch64-linux-gnu-gcc")
    program(machine / "bin", "mmdebstrap", "echo 'E: no such suite' >&2; exit 100")
    apt_knows(machine, MIRROR)
    with pytest.raises(BuildError, match=r"could not be got; .*\nE: no such suite"):
        cross.environment(ARM64, machine / "cache")
    assert [each.name for each in (machine / "cache/rust").iterdir()] == ["arm64.lock"]


def test_the_tree_s_rustc_is_started_with_its_own_libraries(tmp_path: Path) -> None:
    folder = tmp_path / 'a "tree" of $HOME'
    loader = folder / rust_tree.LOADERS[cross.own().machine]
    loader.parent.mkdir(parents=True)
    program(loader.parent, loader.name, 'printf "%s|" "$@"')
    rust_tree.write_program(tmp_path / "rustc", folder)
    done = subprocess.run(
        [tmp_path / "rustc", "--crate-name", "a b"], capture_output=True, text=True, timeout=60,
        check=True,
    )  # fmt: skip
    assert done.stdout.split("|")[:-1] == [
        "--library-path", str(loader.parent), f"{folder}/usr/bin/rustc", "--sysroot",
        f"{folder}/usr", "--crate-name", "a b",
    ]  # fmt: skip


def test_cargo_builds_for_another_architecture_in_a_folder_of_its_own(
    machine: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    program(machine / "bin", "aarch64-linux-gnu-gcc")
    add_target(machine)
    program(machine / "bin", "cargo", f'echo "$CARGO_TARGET_DIR $CC $*" > {machine}/words')
    monkeypatch.setattr(context, "claim", lambda _folder: False)
    built = context.agent_binary(ARM64)
    cargo = machine / "cache/cargo-arm64"
    assert built == cargo / "aarch64-unknown-linux-gnu/release/bagpipe-agent"
    assert (machine / "words").read_text() == (
        f"{cargo} aarch64-linux-gnu-gcc rustc --locked --release --package bagpipe-agent --target"
        " aarch64-unknown-linux-gnu -- -C target-feature=+crt-static\n"
    )


def test_an_image_for_another_architecture_is_kept_from_the_cluster_s(machine: Path) -> None:
    assert machine
    (agent,) = context.foreign(ARM64)
    own = next(image for image in IMAGES if image.name == "agent")
    assert agent.reference == f"{own.reference}-arm64"
    assert build.archive_of(agent) == build.archive_of(own).parent / "arm64/agent.oci.tar"
    assert isinstance(agent.stage, functools.partial)
    assert agent.stage.keywords == {"target": ARM64}
    assert engines.platform(agent) == ["--platform=linux/arm64"]
    assert engines.platform(own) == []


def test_the_cross_compiler_is_installed_only_where_it_is_asked_for(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    wanted: list[list[str]] = []
    monkeypatch.setattr(preflight, "check", lambda: None)
    monkeypatch.setattr(preflight, "install", wanted.append)
    preflight.run([])
    preflight.run(["cross"])
    assert not [each for each in wanted[0] if "gcc-" in each]
    (other,) = (each for each in cross.TARGETS if each != cross.own())
    assert wanted[1] == [other.package, f"libc6-dev-{other.arch}-cross", "qemu-user-static"]
