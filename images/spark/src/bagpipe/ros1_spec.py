"""What a spec says of ROS 1 alone: whose master its nodes find."""

from typing import Literal

from pydantic import BaseModel

from bagpipe.pod_spec import SPEC_CONFIG

# The agent's own, or the rosmaster of the stack's image.
Master = Literal["agent", "image"]


class Ros1(BaseModel):
    """`stack.ros1`."""

    model_config = SPEC_CONFIG

    master: Master = "agent"
