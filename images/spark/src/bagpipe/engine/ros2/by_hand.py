"""ROS 2's own player, for nodes that run already."""

from pathlib import Path

from bagpipe.plan.case import Case
from bagpipe.spec import SimulationJobSpec, Stack


def play_command(
    case: Case, spec: SimulationJobSpec, stack: Stack, begin: int, recording: Path
) -> list[str]:
    """How `ros2 bag play` plays a case's recording, whose first message is of `begin` ns."""
    window = case.window
    start = max(0, window.lead_in_start - begin) / 1e9
    command = ["ros2", "bag", "play", str(recording), "--start-offset", f"{start:.9f}"]
    command += ["--playback-duration", f"{(window.end - window.lead_in_start) / 1e9:.9f}"]
    if spec.source.topics:
        command += ["--topics", *spec.source.topics]
    if spec.playback.mode == "realtime":
        command += ["--rate", f"{spec.playback.rate:g}"]
    if stack.remap:
        command += ["--remap", *(f"{recorded}:={own}" for own, recorded in stack.remap.items())]
    return command
