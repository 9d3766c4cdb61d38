"""What `stack.engine: ros1` reads of a spec."""

from typing import Any

from bagpipe.encodings import ROS1
from bagpipe.engine_fields import EngineFields, Example


def _refusal(spec: Any) -> str | None:
    # Nobody counts what a node of ROS 1 has done with its input: an answer alone shows it.
    if spec.playback.mode == "lockstep" and not spec.playback.steps:
        return (
            "playback.mode: lockstep waits for answers, and playback.steps are missing: write for"
            " example steps: [{trigger: /camera/image, answer: /lane/markings, deadline: 2s}]"
        )
    return None


FIELDS = EngineFields(
    agent="ros1",
    unmarked_lines="agent",
    sources=("bags", "sequence", "simulator"),
    encoding=ROS1,
    needed={"record": "record is missing: write for example record: {topics: [/tf]}"},
    refusal=_refusal,
    example=Example(
        middleware="ROS 1",
        command=("roslaunch", "your_package", "your.launch"),
        sim_time="/use_sim_time",
        needed="ROS 1",
        file=(
            r"(?:usr|opt/ros/[a-z]+)/bin/rosmaster|(?:.*/)?libroscpp[.]so"
            r"|(?:.*/)?rospy/__init__[.]py"
        ),
        remedy="begin with an image such as ros:noetic",
    ),
    meaningless={
        ("stack.ros2",): (
            "stack.ros2 has a meaning with stack.engine: ros2 alone: write that, or leave it out"
        ),
    },
)
