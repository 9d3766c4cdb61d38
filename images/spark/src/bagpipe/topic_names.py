"""Names of topics, as recordings and the ROS graph have them."""


def resolve(topic: str) -> str:
    """A recorded topic as the ROS graph knows it: with its leading slash."""
    return topic if topic.startswith("/") else f"/{topic}"
