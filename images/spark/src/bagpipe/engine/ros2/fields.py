"""What `stack.engine: ros2` reads of a spec."""

from typing import Any

from bagpipe.encodings import CDR
from bagpipe.engine_fields import EngineFields, Example
from bagpipe.ros2_spec import parameters_refusal


def _refusal(spec: Any) -> str | None:
    every = [spec.stack.parameters, *(variant.parameters for variant in spec.variants)]
    return next(filter(None, map(parameters_refusal, every)), None)


FIELDS = EngineFields(
    agent="ros2",
    unmarked_lines="agent",
    sources=("bags", "sequence", "simulator"),
    encoding=CDR,
    needed={"record": "record is missing: write for example record: {topics: [/tf]}"},
    refusal=_refusal,
    example=Example(
        middleware="ROS 2",
        command=("ros2", "launch", "your_package", "your.launch.py"),
        sim_time="/**/use_sim_time",
        needed="ROS 2",
        file=r"(?:usr|opt/ros/[a-z]+)/bin/ros2|(?:.*/)?librcl[.]so",
        remedy="begin with an image such as ros:jazzy",
    ),
    meaningless={
        ("stack.ros1",): (
            "stack.ros1 has a meaning with stack.engine: ros1 alone: write that, or leave it out"
        ),
    },
    reasons=frozenset({"DeliveryUnproved", "NodeInactive", "RecordingIncomplete", "Ros2Failed"}),
)
