"""A closed-loop driving simulator that speaks ROS 1 and ROS 2 (docs/concepts/simulator.md)."""
