"""What readers in use read of bags: rosbags, Debian's rosbag in both languages, and Bagpipe."""

import subprocess
import zlib
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

from rosbags.rosbag1 import Reader

from bagpipe import MemoryBag

HERE = Path(__file__).parent
# Debian's rosbag_storage needs these by hand.
_INCLUDES = ("pluginlib", "class_loader", "rcpputils", "rcutils", "ament_index_cpp")
_LIBRARIES = (
    "rosbag_storage", "roscpp_serialization", "rostime", "cpp_common", "class_loader",
    "console_bridge", "boost_filesystem",
)  # fmt: skip
_SECONDS = 600


@dataclass(frozen=True, order=True)
class ReadMessage:
    """A message and its connection's header, as a reader returns them; long texts as a checksum."""

    topic: str
    time: int
    length: int
    checksum: int
    callerid: str
    latching: bool
    type: str
    md5sum: str
    definition: int


ReadAll = Callable[[Sequence[Path]], dict[Path, list[ReadMessage] | str]]


def read_message(
    topic: str, time: int, data: bytes | memoryview, header: Sequence[Any]
) -> ReadMessage:
    """`header`: callerid, latching, type, md5sum, definition."""
    callerid, latching, kind, md5sum, definition = header
    return ReadMessage(
        topic, time, len(data), zlib.crc32(data), callerid or "", bool(latching),
        kind.replace("/msg/", "/"), md5sum, zlib.crc32(definition.encode()),
    )  # fmt: skip


def by_rosbags(path: Path) -> list[ReadMessage]:
    """The strictest one: it reads every INDEX record by the first one's order of fields."""
    with Reader(path) as reader:
        return [
            read_message(each.topic, time, raw,
                 (each.ext.callerid, each.ext.latching,  # type: ignore[union-attr]
                  each.msgtype, each.digest, each.msgdef.data))
            for each, time, raw in reader.messages()
        ]  # fmt: skip


def by_bagpipe(path: Path) -> list[ReadMessage]:
    """Bagpipe itself, whose check must find nothing either."""
    bag = MemoryBag.open(path)
    checked = bag.check()
    assert checked.sound, checked.problems
    return [
        read_message(each.topic, time, raw,
             (each.callerid, each.latching, each.type, each.md5sum, each.definition))
        for each, time, raw in bag.messages()
    ]  # fmt: skip


def _each(
    read: Callable[[Path], list[ReadMessage]], paths: Sequence[Path]
) -> dict[Path, list[ReadMessage] | str]:
    found: dict[Path, list[ReadMessage] | str] = {}
    for path in paths:
        try:
            found[path] = read(path)
        except Exception as error:  # noqa: BLE001  the other bags are to be read as well
            found[path] = f"{type(error).__name__}: {error}"
    return found


def _by_program(
    command: Sequence[str], paths: Sequence[Path]
) -> dict[Path, list[ReadMessage] | str]:
    done = subprocess.run(
        [*command, *map(str, paths)],
        capture_output=True, text=True, timeout=_SECONDS, check=True,
    )  # fmt: skip
    found: dict[Path, list[ReadMessage] | str] = {}
    names = {str(path): path for path in paths}
    here = paths[0]
    for line in done.stdout.splitlines():
        if line in names:
            here = names[line]
            found[here] = []
            continue
        parts, so_far = line.split("\t"), found[here]
        if len(parts) != 9 or isinstance(so_far, str):
            found[here] = line
            continue
        topic, time, length, crc, callerid, latching, kind, md5sum, definition = parts
        so_far.append(
            ReadMessage(
                topic, int(time), int(length), int(crc), callerid, latching == "1", kind, md5sum,
                int(definition),
            )
        )  # fmt: skip
    return found


def kept_readers(folder: Path) -> dict[str, ReadAll]:
    """Every reader by its name; rosbag's C++ is compiled into `folder`."""
    program = folder / "kept_reader"
    subprocess.run(
        [
            *("g++", "-O1", "-std=c++17", str(HERE / "kept_reader.cpp"), "-o", str(program)),
            *(f"-I/usr/include/{each}" for each in _INCLUDES),
            *(f"-l{each}" for each in _LIBRARIES),
        ],
        check=True,
        timeout=_SECONDS,
    )
    python = ["/usr/bin/python3", str(HERE / "kept_reader.py")]
    return {
        "rosbags": partial(_each, by_rosbags),
        "rosbag (C++)": partial(_by_program, [str(program)]),
        "rosbag (Python)": partial(_by_program, python),
        "bagpipe": partial(_each, by_bagpipe),
    }
