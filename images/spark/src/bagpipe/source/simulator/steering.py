"""Whether anybody steered a simulated drive. Pure."""

from typing import Any

from bagpipe.judgement import Judgement


def judge_steering(result: dict[str, Any], judgement: Judgement, control: str) -> Judgement:
    """A drive that nobody ever steered proves nothing of the stack, whatever was recorded."""
    if judgement.outcome in {"failed", "errored"}:
        return judgement
    steps = result["playback"].get("steps", [])
    if any(step["answered"] for step in steps if step["answer"] == control):
        return judgement
    return Judgement(
        "invalid",
        "NothingAnswered",
        f"the stack never steered: nothing came on {control} in time",
        judgement.allowed,
    )
