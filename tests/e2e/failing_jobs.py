"""Jobs that run long enough to be looked at, and whose cases fail in every way that is cheap."""

from typing import Any

from tests.e2e import fleet, jobs
from tests.e2e import kubectl as k

# A node whose MANNER says how it answers; a slow one loses all but the newest input.
NODE = """
import os, sys, time
import rospy
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64

manner = os.environ.get("MANNER", "well")
if manner == "crashes":
    sys.exit("the laser is on fire")
rospy.init_node("node")
answers = rospy.Publisher("/answer", Float64, queue_size=10)

def answer(_):
    answers.publish(0.0 if manner == "wrong" else 1.0)
    if manner == "slow":
        time.sleep(0.2)

rospy.Subscriber("/joint_states", JointState, answer, queue_size=1 if manner == "slow" else None)
rospy.spin()
"""
# What comes of a case by its manner, as the driver counts it.
REASONS = {"wrong": "CriterionFailed", "crashes": "StackCrashed", "slow": "MessagesLost"}
_STEPS = [{"trigger": "/joint_states", "answer": "/answer"}]


def paced() -> k.Object:
    """In real time: a quarter of the cases passes, and the others fail each in its own manner."""
    made = _make("paced", playback={"mode": "realtime", "rate": 1.0, "rounds": 3})
    made["spec"]["variants"] = [
        {"name": manner, "env": [{"name": "MANNER", "value": manner}]}
        for manner in ("well", *REASONS)
    ]
    return made


def watched() -> k.Object:
    """One case that passes in half a minute, with time to look at it."""
    made = _make("watched", playback={"mode": "realtime", "rate": 0.5})
    made["spec"]["source"] |= {"fragment": {"length": "60s"}}
    made["spec"]["spark"] |= {"slots": 1}
    return made


def stepped() -> k.Object:
    """The same node in lock-step, where it answers each input."""
    return _make("stepped", playback={"mode": "lockstep", "steps": _STEPS, "rounds": 100})


def given_up() -> k.Object:
    """One case that lasts until its executor is taken from it, which it survives three times."""
    made = fleet.make_job("given-up")
    source = {"files": [f"pvc://recordings/{fleet.FOLDER}/000.bin"]}
    endless = {"command": ["sleep", "3600"]}
    spark = {"executors": 1, "slots": 1}
    return made | {
        "spec": _updated(
            made["spec"], source=source, stack=endless, spark=spark, playback={"caseTimeout": "1h"}
        )
    }


def _make(name: str, playback: dict[str, Any]) -> k.Object:
    made = jobs.make_job(name)
    made["spec"] |= {
        "source": made["spec"]["source"] | {"fragment": {"length": "1s"}},
        "stack": {"image": "bagpipe.local/ros:0.2.0", "command": ["python3", "-c", NODE]},
        "playback": {"subscribeTimeout": "60s"} | playback,
        "record": {"topics": ["/answer"]},
        "evaluate": [{"name": "is right", "bounds": {"topic": "/answer", "field": "data",
                                                     "min": 0.5}}],
    }  # fmt: skip
    made["spec"]["spark"] |= {"slots": 2}
    return made


def _updated(spec: k.Object, **sections: dict[str, Any]) -> k.Object:
    return spec | {name: spec.get(name, {}) | fields for name, fields in sections.items()}
