"""The truth of a folder is that of the recording that was planned and played."""

from pathlib import Path

import pytest

from bagpipe.run.case_run import _identity, is_of
from bagpipe.source.bags.folder_stream import folder_file, folder_truth
from bagpipe.storage import StorageError
from bagpipe.wire.session import SessionError
from tests.rosbag2_folders import Form, Message, drive, folder
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


@pytest.mark.parametrize("form", [Form("sqlite3", "", 4), Form("mcap"), Form("mcap", "FILE")])
def test_a_file_with_the_truth_alone_is_of_the_recording_too(tmp_path: Path, form: Form) -> None:
    """No part of the case is of it, and neither is the metadata, which stays as it was."""
    at, messages = tmp_path / "drive", drive()
    played = [each for each in messages if each.topic == "/a"]
    truth = [each for each in messages if each.topic == "/b"]
    metadata = folder(at, form, [played, truth])
    case = planned(metadata, source(["/a"])).cases[0]
    assert len(case.parts) == 1
    assert folder_truth(case, {"/b"}, STORAGE)
    before = (at / "metadata.yaml").stat()
    folder(tmp_path / "again", form, [played, [off_by_one(each) for each in truth]])
    name = min(at.glob("drive_1*")).name
    (tmp_path / "again" / name.replace("drive", "again")).replace(at / name)
    assert (at / "metadata.yaml").stat() == before
    with pytest.raises(StorageError, match="one of its files is no longer the file that was"):
        folder_truth(case, {"/b"}, STORAGE)
    # Nor is what passed against the old truth a row of the new plan.
    (again,) = [each for each in planned(metadata, source(["/a"])).cases if each.id == case.id]
    assert is_of(_identity(case), case)
    assert not is_of(_identity(case), again)


def off_by_one(message: Message) -> Message:
    return message._replace(data=message.data[:8] + b"M" + message.data[9:])
