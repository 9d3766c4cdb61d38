"""Programs of another architecture in a build: QEMU's user mode, in a namespace of the build's own.

    python3 images/build/emulation.py INTERPRETER MACHINE COMMAND...

A user namespace has a table of binary formats of its own (binfmt_misc, from Linux 6.7 on). The
command and what it starts run there: programs of MACHINE are started by INTERPRETER, and nothing
else on this machine notices. The namespace ends with the command, whose process this one becomes.
"""

from __future__ import annotations

import ctypes
import os
import shutil
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path

# By the kernel's names of machines: what an ELF header says (e_machine; System V ABI, chapter 4).
ELF_MACHINES = {"x86_64": 0x3E, "aarch64": 0xB7}
TABLE = Path("/proc/sys/fs/binfmt_misc")
# Those that Debian's own users and daemons have, in a range that a namespace takes as it is.
USERS = 65536
TRY_SECONDS = 30.0
CLONE_NEWNS, CLONE_NEWUSER = 0x00020000, 0x10000000


def words(interpreter: Path, machine: str, command: Sequence[str | Path]) -> list[str]:
    """A command that runs another one where programs of a machine are started by an interpreter."""
    return [sys.executable, __file__, str(interpreter), machine, *map(str, command)]


def lacking(machine: str) -> str:
    """Why no program of a machine can be run in a build here, and the cure; else nothing."""
    program = interpreter(machine)
    if os.geteuid():
        return "only root makes a namespace with all of Debian's users"
    if not program:
        return f"there is no qemu-{machine}-static: `apt-get install qemu-user-static`"
    done = subprocess.run(
        words(program, machine, ["true"]), capture_output=True, text=True, timeout=TRY_SECONDS,
        check=False,
    )  # fmt: skip
    if done.returncode:
        last = (done.stderr.strip().splitlines() or [f"status {done.returncode}"])[-1]
        return f"this kernel has no table of binary formats for a namespace, Linux 6.7 has: {last}"
    return ""


def interpreter(machine: str) -> Path | None:
    """QEMU's program for a machine: the static one, which a build finds from any root."""
    found = shutil.which(f"qemu-{machine}-static")
    return Path(found) if found else None


def entry(interpreter: str, machine: str) -> str:
    """A line of the kernel's table (Documentation/admin-guide/binfmt-misc.rst).

    It names programs and libraries of 64 bits, whatever their ABI: the last bit of e_type is free.
    The interpreter is opened at once (F), as no root of a build has it, and is given the name by
    which a program was called (P); rights of a program are those of its own file (C).
    """
    magic = b"\x7fELF\x02\x01\x01" + bytes(9) + b"\x02\x00" + bytes([ELF_MACHINES[machine], 0])
    mask = b"\xff" * 7 + b"\x00" + b"\xff" * 8 + b"\xfe\xff\xff\xff"
    # mmdebstrap looks for this name.
    return f":qemu-{machine}:M::{_escaped(magic)}:{_escaped(mask)}:{interpreter}:FPC"


def _escaped(data: bytes) -> str:
    return "".join(f"\\x{byte:02x}" for byte in data)


def enter() -> None:
    """Move this process into a user namespace in which each user is who it is outside.

    Raises OSError.
    """
    own = os.getpid()
    begin, begun = os.pipe()
    child = os.fork()
    if child == 0:
        os.close(begun)
        # Nothing comes where the other end could not enter.
        os._exit(0 if not os.read(begin, 1) or _map_users(own) else 1)
    os.close(begin)
    libc = ctypes.CDLL(None, use_errno=True)
    entered = libc.unshare(CLONE_NEWUSER | CLONE_NEWNS) == 0
    code = ctypes.get_errno()
    os.write(begun, b"x" if entered else b"")
    os.close(begun)
    _pid, status = os.waitpid(child, 0)
    if not entered:
        raise OSError(code, f"no namespace: {os.strerror(code)}")
    if status:
        raise OSError("no namespace: its users could not be named")


def _map_users(process: int) -> bool:
    """Only from outside of the namespace may a map name more than one user."""
    try:
        for name in ("uid_map", "gid_map"):
            Path(f"/proc/{process}/{name}").write_text(f"0 0 {USERS}\n")
    except OSError:
        return False
    return True


def main(arguments: Sequence[str]) -> int:
    program, machine, *command = arguments
    try:
        enter()
        subprocess.run(["mount", "-t", "binfmt_misc", "binfmt_misc", TABLE], check=True)
        (TABLE / "register").write_text(entry(program, machine))
        os.execvp(command[0], command)  # noqa: S606 (no shell is wanted)
    except (OSError, subprocess.CalledProcessError) as error:
        print(f"{command[0]}, among programs of {machine}: {error}", file=sys.stderr)
        return 1


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
