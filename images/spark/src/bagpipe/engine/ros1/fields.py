"""What `stack.engine: ros1` reads of a spec."""

from bagpipe.encodings import ROS1
from bagpipe.engine_fields import EngineFields

FIELDS = EngineFields(
    agent="ros1",
    unmarked_lines="agent",
    sources=("bags", "sequence", "simulator"),
    encoding=ROS1,
    needed={"record": "record is missing: write for example record: {topics: [/tf]}"},
    meaningless={
        ("stack.ros2",): (
            "stack.ros2 has a meaning with stack.engine: ros2 alone: write that, or leave it out"
        ),
    },
)
