"""A closed-loop driving simulator that speaks ROS 1 messages (docs/concepts/simulator.md)."""
