"""What `stack.engine: exec` reads of a spec."""

from bagpipe.engine_fields import EngineFields

FIELDS = EngineFields(
    agent="exec",
    # The program's stderr is all that its container's log has of it.
    unmarked_lines="stack",
    sources=("bags", "sequence", "files"),
    meaningless={
        ("stack.ros1",): (
            "stack.ros1 has a meaning with stack.engine: ros1 alone: write that, or leave it out"
        ),
        ("stack.ros2",): (
            "stack.ros2 has a meaning with stack.engine: ros2 alone: write that, or leave it out"
        ),
        ("evaluate",): (
            "evaluate has no meaning with stack.engine: exec, whose program judges itself:"
            " leave it out"
        ),
        ("record",): "record has no meaning with stack.engine: exec: leave it out",
        ("stack.parameters", "stack.remap"): (
            "stack.parameters and stack.remap have no meaning with stack.engine: exec:"
            " write stack.env or words of stack.command"
        ),
        ("playback.mode", "playback.rate", "playback.wait_for"): (
            "playback.mode, steps, rate and waitFor have no meaning with stack.engine: exec:"
            " write only playback.caseTimeout"
        ),
    },
)
