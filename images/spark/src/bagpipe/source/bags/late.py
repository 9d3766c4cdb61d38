"""What a job wants late subscribers to get of recorded topics."""

from bagpipe.plan.in_force import Late
from bagpipe.spec import Stack


def late_of(stack: Stack) -> dict[str, Late]:
    """By recorded topic, as far as the spec differs from the recording."""
    if stack.ros2 is None:
        return {}
    return {
        topic: Late(
            None if qos.durability is None else qos.durability == "transientLocal", qos.depth
        )
        for topic, qos in stack.ros2.qos.items()
        if qos.durability is not None or qos.depth is not None
    }
