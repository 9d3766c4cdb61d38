"""Files whose names are no UTF-8, as old file systems have them, cost no other recording."""

import os
from pathlib import Path

from bagpipe.source.planning import plan
from bagpipe.storage import Storage
from tests import ros2_recording
from tests.unit.bagpipe.jobs import make_spec

STACK = {"engine": "ros2", "image": "i", "command": ["c"]}


def test_two_recordings_of_one_name_in_latin_1(tmp_path: Path) -> None:
    (tmp_path / "good").mkdir()
    ros2_recording.write(tmp_path / "good/drive.mcap", ["/in"], 4)
    for folder in ("one", "two"):
        (tmp_path / folder).mkdir()
        ros2_recording.write(tmp_path / folder / os.fsdecode(b"stra\xdfe.mcap"), ["/in"], 4)
    source = {"topics": ["/in"], "bags": ["pvc://recordings/*/*"]}
    spec = make_spec(source=source, stack=STACK, record={"topics": ["/o"]})
    made = plan(spec, Storage({"recordings": str(tmp_path)}))
    assert "drive-0000" in [case.id for case in made.cases]
