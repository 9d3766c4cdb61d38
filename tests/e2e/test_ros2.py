"""Jobs of ROS 2 nodes over MCAP on the cluster.

At full speed nothing is lost, and lock-step records the same bytes each time. The client library of
the image is the stand-in over Debian's Cyclone DDS.
"""

from pathlib import Path
from typing import Any

import pytest

from tests import ros2_recording
from tests.e2e import jobs
from tests.e2e import kubectl as k

pytestmark = [pytest.mark.e2e, pytest.mark.usefixtures("recordings")]

MESSAGES = 1000
STRING = "std_msgs/msg/String:10:reliable"


def job(name: str, playback: dict[str, Any]) -> k.Object:
    """A node that answers each message of /in on /out, in four fragments."""
    subscription = f"/in:{ros2_recording.IMU}:10:reliable"
    topics = ["--sub", subscription, "--pub", f"/out:{STRING}", "--relay", "/in=/out"]
    spec = {
        "source": {
            "bags": ["pvc://recordings/ros2/drive.mcap"],
            "fragment": {"length": "1250ms"},
        },
        "stack": {
            "engine": "ros2",
            "image": "bagpipe.local/ros2-standin:0.2.0",
            "command": ["standin_node", "--name", "/relay", *topics],
        },
        "playback": playback | {"subscribeTimeout": "120s"},
        "record": {"topics": ["/out"]},
        "evaluate": [{"name": "answers", "presence": {"topic": "/out", "min": 240}}],
        "spark": jobs.spark(1, 2),
        "output": {"uri": "pvc://results/ros2"},
    }
    kind = {"apiVersion": "sim.bagpipe.io/v1alpha1", "kind": "SimulationJob"}
    return kind | {"metadata": {"name": name}, "spec": spec}


def run(namespace: str, manifest: k.Object) -> dict[str, str]:
    """The digest of each case's recording, once all have passed with every message called."""
    name = manifest["metadata"]["name"]
    with jobs.applied(namespace, manifest):
        ended = jobs.ended(namespace, name, 400)
        status = ended["status"]
        account = jobs.account(namespace, ended)
        assert (status["phase"], status.get("verdict")) == ("Complete", "Passed"), account
        _, rows = k.results(namespace, status["results"])
        assert sum(row["result"]["ledger"]["sent"] for row in rows) == MESSAGES
        digests = {}
        for row in rows:
            ledger = row["result"]["ledger"]
            assert (ledger["received"], ledger["dropped"]) == (ledger["sent"], 0)
            assert (ledger["strength"], row["attempts"]) == ("called", 1)
            path = "/" + status["results"].removeprefix("pvc://") + "/" + row["recorded"]
            digests[row["case"]] = k.in_toolbox(namespace, "sha256sum", path).split()[0]
        return digests


def test_lock_step_is_the_same_twice_and_full_speed_loses_nothing(
    namespace: str, tmp_path: Path
) -> None:
    drive = ros2_recording.write(tmp_path / "drive.mcap", ["/in"], MESSAGES)
    k.put(namespace, drive, "ros2/drive.mcap")
    steps = [{"trigger": "/in", "answer": "/out", "deadline": "60s"}]
    lockstep = {"mode": "lockstep", "steps": steps}
    once = run(namespace, job("ros2-lockstep-once", lockstep))
    assert len(once) == 4
    assert run(namespace, job("ros2-lockstep-again", lockstep)) == once
    assert run(namespace, job("ros2-max", {"mode": "max"})).keys() == once.keys()
