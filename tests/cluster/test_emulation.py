"""Programs of another architecture in a build: who starts them, and who else notices."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path

import build
import context
import cross
import emulation
import engines
import pytest
from context import Image

SECONDS = 60.0
OWN = cross.own()
(OTHER,) = (target for target in cross.TARGETS if target != OWN)


def elf(path: Path, machine: str, kind: int = 2) -> Path:
    """As much of a program of 64 bits as the kernel's table looks at."""
    head = b"\x7fELF\x02\x01\x01" + bytes(9) + bytes([kind, 0, emulation.ELF_MACHINES[machine], 0])
    path.write_bytes(head + bytes(64))
    path.chmod(0o755)
    return path


def run(*command: str | Path) -> subprocess.CompletedProcess[str]:
    """Where `echo` starts the other architecture's programs."""
    return subprocess.run(
        emulation.words(Path("/bin/echo"), OTHER.machine, command), capture_output=True,
        text=True, timeout=SECONDS, check=False,
    )  # fmt: skip


@pytest.mark.parametrize("kind", [2, 3], ids=["executable", "position-independent"])
def test_the_interpreter_gets_the_program_its_name_and_its_words(tmp_path: Path, kind: int) -> None:
    program = elf(tmp_path / "program", OTHER.machine, kind)
    assert run("sh", "-c", f'exec "{program}" "a b" c').stdout == f"{program} {program} a b c\n"


def test_nobody_else_on_the_machine_can_run_it(tmp_path: Path) -> None:
    program = elf(tmp_path / "program", OTHER.machine)
    assert run(program).returncode == 0
    with pytest.raises(OSError, match="Exec format error"):
        subprocess.run([program], check=False)


def test_programs_of_other_machines_are_not_its(tmp_path: Path) -> None:
    shared_object = elf(tmp_path / "core", OTHER.machine, kind=4)
    own = elf(tmp_path / "own", OWN.machine)
    for each in (shared_object, own):
        done = run(each)
        assert done.returncode == 1
        assert f"{each}, among programs of {OTHER.machine}: [Errno 8] Exec" in done.stderr


def test_a_build_s_users_and_files_are_those_outside(tmp_path: Path) -> None:
    done = run("sh", "-c", f"touch {tmp_path}/file; chown 10001:42 {tmp_path}/file; id -u")
    assert done.stdout == "0\n"
    found = (tmp_path / "file").stat()
    assert (found.st_uid, found.st_gid) == (10001, 42)


def test_what_it_mounts_ends_with_it(tmp_path: Path) -> None:
    before = Path("/proc/self/mountinfo").read_text()
    assert run("sh", "-c", f"mount -t tmpfs x {tmp_path} && touch {tmp_path}/file").returncode == 0
    assert not list(tmp_path.iterdir())
    assert Path("/proc/self/mountinfo").read_text() == before


def test_the_command_has_the_process_and_gets_its_signals() -> None:
    command = emulation.words(Path("/bin/echo"), OTHER.machine, ["sh", "-c", "echo $$; read line"])
    with subprocess.Popen(
        command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    ) as begun:
        assert begun.stdout
        assert begun.stdout.readline() == f"{begun.pid}\n"
        begun.terminate()
        assert begun.wait(SECONDS) == -signal.SIGTERM


def test_a_command_s_status_is_passed_on() -> None:
    assert run("sh", "-c", "exit 7").returncode == 7
    done = run("no-such-program")
    assert done.returncode == 1
    assert done.stderr.startswith(f"no-such-program, among programs of {OTHER.machine}: [Errno 2]")


@pytest.fixture
def programs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The folder on PATH, after that of the program which it takes to enter a namespace."""
    folder = tmp_path / "bin"
    folder.mkdir()
    monkeypatch.setenv("PATH", f"{folder}:/usr/bin:/bin")
    monkeypatch.setenv("BAGPIPE_CACHE", str(tmp_path / "cache"))
    monkeypatch.setattr(
        emulation.shutil,
        "which",
        lambda name: f"{folder}/{name}" if (folder / name).exists() else None,
    )
    return folder


def installed(folder: Path, name: str) -> None:
    (folder / name).write_text("#!/bin/sh\n")
    (folder / name).chmod(0o755)


def test_what_emulation_lacks_is_named_with_its_cure(
    programs: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    qemu = f"qemu-{OTHER.machine}-static"
    assert emulation.lacking(OTHER.machine) == (
        f"there is no {qemu}: `apt-get install qemu-user-static`"
    )
    installed(programs, qemu)
    assert emulation.lacking(OTHER.machine) == ""
    # A kernel without such tables: its mount fails.
    monkeypatch.setattr(emulation, "words", lambda *_: ["sh", "-c", "echo 'mount: no' >&2; exit 1"])
    assert emulation.lacking(OTHER.machine) == (
        "this kernel has no table of binary formats for a namespace, Linux 6.7 has: mount: no"
    )
    monkeypatch.setattr(emulation.os, "geteuid", lambda: 10001)
    assert emulation.lacking(OTHER.machine) == (
        "only root makes a namespace with all of Debian's users"
    )


def test_images_with_a_base_are_another_architecture_s_where_its_programs_run(
    programs: Path,
) -> None:
    assert [image.name for image in context.foreign(OTHER)] == ["agent"]
    assert context.unemulated(OTHER) == "there is no buildah: run `make preflight`"
    installed(programs, "buildah")
    assert [image.name for image in context.foreign(OTHER)] == ["agent"]
    installed(programs, f"qemu-{OTHER.machine}-static")
    found = {image.name: image for image in context.foreign(OTHER)}
    assert list(found) == ["agent", "operator", "spark"]
    assert {image.target for image in found.values()} == {OTHER}
    assert found["operator"].base == context.BASE
    assert build.archive_of(found["spark"]).parts[-3:] == ("images", OTHER.arch, "spark.oci.tar")


def test_they_are_built_after_all_others_by_a_buildah_of_their_own(
    programs: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name in ("buildah", f"qemu-{OTHER.machine}-static"):
        installed(programs, name)
    built: list[tuple[object, list[str]]] = []

    def ensure_all(engine: object, images: Sequence[Image], _archives: bool) -> None:
        built.append((engine, [image.key for image in images]))

    monkeypatch.setattr(build, "ensure_all", ensure_all)
    first = engines.Docker()
    build.build_all(first, ["operator", "agent"], [OTHER], archives=True)
    (engine, own), (emulating, foreign) = built
    assert engine is first
    assert own == ["agent", "operator", f"agent-{OTHER.arch}"]
    assert foreign == [f"operator-{OTHER.arch}"]
    assert isinstance(emulating, engines.Buildah)
    command = emulating._command("images")
    assert command[:2] == [sys.executable, emulation.__file__]
    assert command[2:4] == [f"{programs}/qemu-{OTHER.machine}-static", OTHER.machine]
    root = command[command.index("--root") + 1]
    assert root == f"{os.environ['BAGPIPE_CACHE']}/buildah-{OTHER.arch}/storage"
