"""The agent's player by itself, for nodes that run already."""

from pathlib import Path

from bagpipe.plan.case import Case
from bagpipe.spec import SimulationJobSpec


def play_command(case: Case, spec: SimulationJobSpec, begin: int, bag: Path) -> list[str]:
    """How the agent alone plays a case's bag, whose first message is of `begin` ns."""
    window = case.window
    start = max(0, window.lead_in_start - begin) / 1e9
    command = ["bagpipe-agent", "play", str(bag), "--start", f"{start:.9f}"]
    command += ["--duration", f"{(window.end - window.lead_in_start) / 1e9:.9f}"]
    if spec.source.topics:
        command += ["--topics", *spec.source.topics]
    if spec.playback.mode == "max":
        command += ["--immediate"]
    elif spec.playback.mode == "realtime":
        command += ["--rate", f"{spec.playback.rate:g}"]
    for step in spec.playback.steps:
        command += ["--step", f"{step.trigger}={step.answer}"]
    return command
