"""Two versions of a stack as two images: each runs its own cases, and the status compares them."""

from typing import Any

import pytest

from tests.e2e import jobs
from tests.e2e import kubectl as k

pytestmark = [pytest.mark.e2e, pytest.mark.usefixtures("recordings")]

RELEASED, CANDIDATE = "bagpipe.local/ros:0.2.0", "bagpipe.local/example-nodes:0.2.0"
FRAGMENTS = 4

# Answers every reading with 1 in the one image and with 0 in the other, which alone has a folder.
NODE = """
import os
import rospy
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64

rospy.init_node("node")
answers = rospy.Publisher("/answer", Float64, queue_size=10)
value = 0.0 if os.path.exists("/opt/nodes") else 1.0
rospy.Subscriber("/joint_states", JointState, lambda _: answers.publish(value), queue_size=10)
rospy.spin()
"""


def job() -> k.Object:
    made = jobs.make_job("two-images")
    made["spec"] |= {
        "source": made["spec"]["source"] | {"fragment": {"length": "4s"}},
        "stack": {"image": RELEASED, "command": ["python3", "-c", NODE]},
        "variants": [{"name": "released"}, {"name": "candidate", "image": CANDIDATE}],
        "playback": {
            "mode": "lockstep", "steps": [{"trigger": "/joint_states", "answer": "/answer"}],
        },
        "record": {"topics": ["/answer"]},
        "evaluate": [{"name": "is right", "bounds": {"topic": "/answer", "field": "data",
                                                     "min": 0.5}}],
    }  # fmt: skip
    return jobs.patient(made)


def executor(namespace: str, name: str) -> k.Object | None:
    """The job's executor pod, while it is there."""
    selector = f"sim.bagpipe.io/job={name},sim.bagpipe.io/role=executor"
    pods = k.items(namespace, "pods", "-l", selector)
    return pods[0] if pods else None


def test_each_image_runs_its_variant_s_cases_and_the_worse_one_is_reported(namespace: str) -> None:
    with jobs.applied(namespace, job()) as name:
        pod = k.await_that("an executor", lambda: executor(namespace, name), 300)
        containers = {each["name"]: each["image"] for each in pod["spec"]["initContainers"]}
        assert (containers["stack"], containers["stack-1"]) == (RELEASED, CANDIDATE)
        status = jobs.ended(namespace, name, 400)["status"]
        assert (status["phase"], status["verdict"]) == ("Complete", "Failed"), status
        cases = status["cases"]
        counts = [cases[each] for each in ("planned", "passed", "failed", "errored")]
        assert counts == [2 * FRAGMENTS, FRAGMENTS, FRAGMENTS, 0]
        (compared,) = status["comparisons"]
        assert (compared["variant"], compared["verdict"]) == ("candidate", "worse")
        assert (compared["regressed"], compared.get("fixed", 0)) == (FRAGMENTS, 0)
        _, rows = k.results(namespace, status["results"])
    assert figures(rows) == {"released": {1.0}, "candidate": {0.0}}


def figures(rows: list[k.Object]) -> dict[str, set[Any]]:
    """What the criterion measured, by variant."""
    found: dict[str, set[Any]] = {}
    for row in rows:
        (finding,) = row["criteria"]
        found.setdefault(row["variant"], set()).add(finding["figure"])
    return found
