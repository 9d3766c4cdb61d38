"""Nodes of ROS 2, around whatever middleware their image has (docs/concepts/playback.md)."""
