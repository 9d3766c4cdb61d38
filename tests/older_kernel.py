"""A program and all that it starts, as on a kernel before Linux 6.15.

    python3 -m tests.older_kernel PROGRAM ARGUMENTS...

There a pidfd does not say how its process ended once that was collected: PIDFD_GET_INFO fails.
"""

import ctypes
import errno
import os
import platform
import struct
import sys

_NO_NEW_PRIVS = 38
_SET_SECCOMP = 22
_FILTER = 2
_ALLOW = 0x7FFF0000
_ERRNO = 0x00050000
_LOAD, _EQUAL, _AND, _RETURN = 0x20, 0x15, 0x54, 0x06
_IOCTL = {"x86_64": 16, "aarch64": 29}
# Magic and number of linux/pidfd.h; a request has its size and direction above.
_GET_INFO = 0xFF << 8 | 11
# In struct seccomp_data: the system call, and the low half of its second argument.
_CALL, _REQUEST = 0, 24


def _program() -> bytes:
    """Instructions of `struct sock_filter`, of which the two jumps are forward."""
    lines = [
        (_LOAD, 0, 0, _CALL),
        (_EQUAL, 0, 4, _IOCTL[platform.machine()]),
        (_LOAD, 0, 0, _REQUEST),
        (_AND, 0, 0, 0xFFFF),
        (_EQUAL, 0, 1, _GET_INFO),
        (_RETURN, 0, 0, _ERRNO | errno.ENOTTY),
        (_RETURN, 0, 0, _ALLOW),
    ]
    return b"".join(struct.pack("HBBI", *line) for line in lines)


def _must(result: int) -> None:
    if result != 0:
        raise OSError(ctypes.get_errno(), os.strerror(ctypes.get_errno()))


def main() -> None:
    library = ctypes.CDLL(None, use_errno=True)
    program = _program()
    instructions = ctypes.create_string_buffer(program, len(program))
    # struct sock_fprog: their number, and where they are.
    filters = struct.pack("HP", len(program) // 8, ctypes.addressof(instructions))
    _must(library.prctl(_NO_NEW_PRIVS, 1, 0, 0, 0))
    _must(library.prctl(_SET_SECCOMP, _FILTER, filters, 0, 0))
    os.execv(sys.argv[1], sys.argv[1:])  # noqa: S606


if __name__ == "__main__":
    main()
