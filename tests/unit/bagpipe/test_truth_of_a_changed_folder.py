"""The truth of a folder is that of the recording that was planned and played."""

from pathlib import Path

import pytest

from bagpipe.source.bags.folder_stream import folder_file, folder_truth
from bagpipe.storage import StorageError
from bagpipe.wire.session import SessionError
from tests.rosbag2_folders import Form, drive, folder
from tests.unit.bagpipe.test_rosbag2_planning import STORAGE, planned, source, split


def test_a_folder_that_was_recorded_again_is_no_truth_of_the_old_one(tmp_path: Path) -> None:
    at = tmp_path / "drive"
    metadata = folder(at, Form("mcap"), split(drive(), 30))
    case = planned(metadata, source(["/a"])).cases[0]
    at.rename(tmp_path / "old")
    others = [each._replace(data=each.data[:8] + b"M" + each.data[9:]) for each in drive()]
    folder(at, Form("mcap"), split(others, 30))
    with pytest.raises((StorageError, SessionError)):
        b"".join(folder_file(case, STORAGE, {}).pieces())
    with pytest.raises((StorageError, SessionError)):
        folder_truth(case, {"/b"}, STORAGE)
