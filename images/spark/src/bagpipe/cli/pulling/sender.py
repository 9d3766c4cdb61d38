"""The program that runs in the pod: it lists a folder, and sends files of it as a tar.

Its text goes into the pod, whose image need not have this version of Bagpipe, or any: it imports
the standard library alone, of Python 3.7 or later.

stdout gets a line with a number of bytes and as many bytes of JSON: {"files": [[name, size,
version]], "others": [names of links, devices and the like]}. stdin then has a line of JSON, the
names that are wanted. What follows on stdout is a tar: for each of them a member that is called by
its place among them, from 0 on, and one called `N.sha256` with the digest of what was sent. Names
are in no header, so none can lead anywhere.
"""

from __future__ import annotations

import hashlib
import json
import os
import stat
import sys
import tarfile
from pathlib import Path
from typing import Any, BinaryIO

MOST = 200_000
PIECE_BYTES = 1 << 18


def version(found: os.stat_result) -> str:
    """A mark that changes with a file's content."""
    return f"{found.st_size}-{found.st_mtime_ns}"


def listed(top: str) -> dict[str, Any]:
    """All that is below a folder, without following links."""
    files: list[list[Any]] = []
    others: list[str] = []
    folders = [""]
    while folders:
        folder = folders.pop()
        for entry in os.scandir(f"{top}/{folder}"):
            name = f"{folder}/{entry.name}" if folder else entry.name
            if entry.is_dir(follow_symlinks=False):
                folders.append(name)
            elif entry.is_file(follow_symlinks=False):
                found = entry.stat(follow_symlinks=False)
                files.append([name, found.st_size, version(found)])
            else:
                others.append(name)
            if len(files) + len(others) + len(folders) > MOST:
                sys.exit(f"the folder has more than {MOST:,} files")
    return {"files": files, "others": others}


def send(top: str, names: list[str], known: dict[str, str], out: BinaryIO) -> None:
    """The files as a tar."""
    for number, name in enumerate(names):
        size, digest = send_one(top, str(number), name, known[name], out)
        pad(out, size)
        head(out, f"{number}.sha256", len(digest))
        out.write(digest)
        pad(out, len(digest))
    out.write(bytes(2 * tarfile.BLOCKSIZE))
    out.flush()


def send_one(top: str, number: str, name: str, known: str, out: BinaryIO) -> tuple[int, bytes]:
    """One file, of which what is sent is what is counted and digested."""
    # What is no file by now, a FIFO say, would be waited for.
    descriptor = os.open(f"{top}/{name}", os.O_RDONLY | os.O_NOFOLLOW | os.O_NONBLOCK)
    with os.fdopen(descriptor, "rb") as file:
        found = os.fstat(descriptor)
        if not stat.S_ISREG(found.st_mode) or version(found) != known:
            sys.exit(f"{name!r} was changed while it was copied")
        digest, left = hashlib.sha256(), found.st_size
        head(out, number, left)
        while left:
            piece = file.read(min(PIECE_BYTES, left))
            if not piece:
                sys.exit(f"{name!r} became shorter while it was copied")
            out.write(piece)
            digest.update(piece)
            left -= len(piece)
    return found.st_size, digest.hexdigest().encode()


def head(out: BinaryIO, name: str, size: int) -> None:
    """A member's header, of one block: no name is long, and of sizes any can be written."""
    member = tarfile.TarInfo(name)
    member.size = size
    out.write(member.tobuf(tarfile.GNU_FORMAT))


def pad(out: BinaryIO, size: int) -> None:
    """The rest of a member's last block."""
    out.write(bytes(-size % tarfile.BLOCKSIZE))


def main() -> None:
    """Lists, reads what is wanted, sends."""
    top, out = sys.argv[1], sys.stdout.buffer
    if not Path(top).is_dir():
        sys.exit("there is no such folder on the claim")
    found = listed(top)
    text = json.dumps(found).encode()
    out.write(b"%d\n" % len(text) + text)
    out.flush()
    line = sys.stdin.readline()
    if line:
        send(top, json.loads(line), {name: mark for name, _, mark in found["files"]}, out)


if __name__ == "__main__":
    try:
        main()
    except OSError as error:
        sys.exit(f"{error.filename or 'the folder'} can't be read: {error.strerror}")
