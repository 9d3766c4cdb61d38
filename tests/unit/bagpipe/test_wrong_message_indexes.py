"""MCAP whose message indexes have other times than the messages. Windows are planned by them, so
that cases may be missing: those that are there are errored.
"""

import struct
from pathlib import Path

import pytest
import zstandard

from bagpipe.native import native
from bagpipe.source.bags.folder_stream import folder_file
from bagpipe.wire.session import SessionError
from tests.rosbag2_folders import MS, START, Form, Message, folder, text
from tests.unit.bagpipe.test_rosbag2_planning import STORAGE, planned, source

SECOND = 1000 * MS
_MESSAGE_INDEX = 0x07


def wrong(data: bytes) -> bytes:
    """With the message indexes' times from 2 s to 8 s made 1 s."""
    made, at = bytearray(data), 8
    while at < len(made) - 8:
        op, length = struct.unpack_from("<BQ", made, at)
        if op == _MESSAGE_INDEX:
            for entry in range(at + 15, at + 9 + length, 16):
                (time,) = struct.unpack_from("<Q", made, entry)
                if START + 2 * SECOND <= time < START + 8 * SECOND:
                    struct.pack_into("<Q", made, entry, START + SECOND)
        at += 9 + length
    return bytes(made)


@pytest.mark.parametrize("form", [Form("mcap"), Form("mcap", "FILE", 5)], ids=str)
def test_cases_with_a_message_index_of_other_times_are_errored(form: Form, tmp_path: Path) -> None:
    messages = [Message("/a", START + number * SECOND, text(f"{number}")) for number in range(11)]
    metadata = folder(tmp_path / "drive", form, [messages], chunk_bytes=100_000)
    assert len(planned(metadata, source()).cases) == 5
    (file,) = (each for each in metadata.parent.iterdir() if ".mcap" in each.name)
    data = file.read_bytes()
    if form.mode:
        data = zstandard.ZstdDecompressor().decompress(data, max_output_size=1 << 20)
        file.write_bytes(zstandard.ZstdCompressor().compress(wrong(data)))
    else:
        file.write_bytes(wrong(data))
    cases = planned(metadata, source()).cases
    assert [case.id for case in cases] == ["drive-0000", "drive-0004"]
    for case in cases:
        if form.mode:
            with pytest.raises(SessionError, match="at the times that its message index has"):
                folder_file(case, STORAGE, {})
            continue
        # What goes to a player as it is stored is refused there, as any damage.
        data = b"".join(folder_file(case, STORAGE, {}).pieces())
        damage = native("MemoryMcap", "a test")(data).damage
        assert "at the times that its message index has" in damage.description
