"""ROS 1 nodes, played to by the agent, whose answers are recorded as a bag."""
